"""Larger deviations of all strides of an estimate."""

import numpy as np

from jgait.notes import Note
from jgait.types import Estimate, as_float

RATES_SHARE = 2.0
"""[1] Relative standard deviation of a stride's length, per logarithm of the factor of the rates; lengths grow with the
square of the interval between samples."""


def rates_share(note: Note) -> float:
    """Relative standard deviation of stride lengths [1], from a note `RATES_OFF`."""
    return RATES_SHARE * abs(float(np.log(as_float(note.values["factor"]))))


def wider(result: Estimate, share: np.ndarray) -> Estimate:
    """The estimate with an additional relative deviation (n,) [1] of strides, and of their part of the distance.

    Errors of strides are taken to have one cause, so that they add up in the distance.
    """
    strides, deviations, diagnostics = result.strides, result.strides_stddev, dict(result.diagnostics)
    if not share.any():
        return result
    if "distance_stddev" in diagnostics:
        lengths = np.where(np.asarray(strides.valid, bool), as_float(strides.length), 0.0)
        errors = np.cumsum(share * lengths) / max(float(lengths.sum()), 1e-9)
        so_far = np.interp(as_float(result.time), as_float(strides.end), errors, left=0.0)
        more = so_far * abs(float(result.distance[-1]))
        diagnostics["distance_stddev"] = np.hypot(as_float(diagnostics["distance_stddev"]), more)
    if deviations is not None:
        deviations = deviations._replace(**{
            name: np.hypot(as_float(spread), share * np.abs(as_float(getattr(strides, name))))
            for name in ("length", "speed", "step_length") if (spread := getattr(deviations, name)) is not None
        })  # fmt: skip
    return result._replace(strides_stddev=deviations, diagnostics=diagnostics)
