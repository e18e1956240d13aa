"""Description of the waist's estimator: body measures, table columns, figures and flags."""

from typing import Any

import numpy as np
from jaxtyping import PyTree

from jgait.estimators.about import About, BodyMeasure, EstimatedRecording, EstimateFigure, EstimateTable, MissingMeasure
from jgait.estimators.stride_flags import DOUBTFUL, HALF, SIDE_UNKNOWN, TURNING, UNEVEN_DURATION, UNSURE
from jgait.estimators.totals import LEG_STRIDES, WAY, has_strides
from jgait.estimators.waist.params import DEFAULT, DETECTORS, PAPER
from jgait.events.trunk import PaperRule
from jgait.types import SIDES, Estimate, as_float

SIDE_KNOWN = 0.9
"""[1] Least probability with which the side of a contact counts as known."""


def contacts(estimate: Estimate) -> dict[str, Any]:
    """The initial contacts: time [s], side ("unknown" below `SIDE_KNOWN`) and its probability."""
    diagnostics = estimate.diagnostics
    likely = as_float(diagnostics["initial_contact_side_probability"])
    both = zip(diagnostics["initial_contact_side"], likely, strict=True)
    sides = [SIDES[int(side)] if p >= SIDE_KNOWN else "unknown" for side, p in both]
    return {"time_s": as_float(diagnostics["initial_contact"]), "side": sides, "side_probability": likely}


def _drawn(made: EstimatedRecording) -> tuple[tuple[PyTree, ...], dict[str, PyTree]]:
    wavelet = isinstance(DETECTORS[made.settings["options"].detector], PaperRule)  # which other detectors do not use
    return (made.estimate,), {"wavelet": wavelet}


ABOUT = About(
    title="Contacts, strides and distance from one sensor at the waist",
    needs="waist_gyr_x … waist_acc_z (or lower_back, or pelvis), mounted in any way.",
    source="Köse et al. 2011",
    default=DEFAULT,
    paper=PAPER,
    measures=(
        BodyMeasure("height", "m", 0.8, 2.4, "height of the person", "--height", parameter="pendulum_length"),
        BodyMeasure(
            "sensor_height", "m", 0.4, 1.6, "height of the sensor above the ground", "--sensor-height", 0.97,
            parameter="pendulum_length",
        ),
    ),
    missing=(
        MissingMeasure(
            ("height", "sensor_height"),
            "the sensor is taken to be {p.pendulum_length:g} m above the ground; a tenth of it more makes steps about "
            "6 % longer",
            any_one=True,
        ),
    ),
    facts=lambda estimate: [("contacts", str(np.size(estimate.diagnostics["initial_contact"])))],
    tables=(EstimateTable("contacts", contacts, json="contacts"), EstimateTable("strides", "strides", json="strides")),
    figures=(
        LEG_STRIDES,
        WAY._replace(when=has_strides),
        EstimateFigure(
            "trunk_contacts", "contacts", lambda made: bool(np.size(made.diagnostics["initial_contact"])), _drawn,
            "Accelerations of the trunk and the initial contacts of both feet, about the middle contact.",
        ),
    ),
    flags=(TURNING, HALF, UNEVEN_DURATION, DOUBTFUL, UNSURE, SIDE_UNKNOWN),
    losses=(
        "distance", "stride_length", "stride_time", "contact_times", "likelihood", "calibration",
    ),
)  # fmt: skip
"""The description of `waist`."""
