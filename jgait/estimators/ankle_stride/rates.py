"""A wrong scale of a shank's rates, or of the interval between samples, detected from innovations.

With rates that are too large or too small the integrated inclination of a standing shank contradicts gravity. The NIS
of a leg is nearly a parabola of the rates' scale; its vertex is the scale that fits.
"""

from collections.abc import Callable

import numpy as np

from jgait.estimators.ankle_stride.inputs import AnkleInputs, AnkleSignals
from jgait.estimators.ankle_stride.params import AnkleOptions, AnkleParams
from jgait.estimators.interface import pad
from jgait.estimators.programs import bucket
from jgait.quality import SensorQuality
from jgait.types import SIDES, Estimate

FACTORS = (0.85, 1.0, 1.18)
"""[1] Scales of the rates for which the filter is run."""

NIS_FROM = 0.03
"""[1] Least NIS of a leg for which scales are tried; most good walks are below, all with rates off by 15 % above."""

BETTER, OFF_FROM = 0.6, 0.1
"""[1] Limits for a wrong scale: largest NIS with the best scale over that with the scale 1, and least logarithm of the
best scale. Undamaged shanks, public and simulated, have 0.9 and 0.05; one has 0.15, but hardly a smaller NIS."""

FARTHEST = 1.4
"""[1] Largest scale that is stated, and inverse of the smallest: a scale far from `FACTORS` is hardly known."""

FEWEST_STRIDES = 4
"""[1] Least number of strides of a leg."""


def rates_off(
    run: Callable[..., Estimate], inputs: AnkleInputs, options: AnkleOptions, nis: dict[int, float],
    places: dict[int, str],
) -> dict[str, SensorQuality]:  # fmt: skip
    """Sensors whose rates have a wrong scale, by `ankle_stride.run` of inputs without padding.

    `nis` maps a side (0 right, 1 left) to the NIS of all observations of the leg [1], `places` to its placement.
    """
    legs = {side: leg for side, leg in enumerate((inputs.right, inputs.left)) if leg is not None}
    asked = [side for side, leg in legs.items() if nis[side] > NIS_FROM and int(leg.count) >= FEWEST_STRIDES]
    if not asked:
        return {}
    estimates: list[Estimate] = []
    for factor in FACTORS:
        now = inputs._replace(**{SIDES[side]: _scaled(leg, factor) for side, leg in legs.items()})
        padded = pad(now, bucket(len(inputs.time)))
        estimates.append(run(AnkleParams(), padded, options))
    quality = {}
    for side in asked:
        each = np.array([float(estimate.diagnostics[f"nis_{SIDES[side]}"]) for estimate in estimates])
        bend, slope, _ = np.polyfit(FACTORS, each, 2)
        if bend > 0.0 and each.min() < BETTER * each[1]:
            factor = float(np.clip(-0.5 * slope / bend, 1.0 / FARTHEST, FARTHEST))
            if abs(np.log(factor)) > OFF_FROM:
                quality[places[side]] = SensorQuality(rates_factor=factor, rates_off=True)
    return quality


def _scaled(leg: AnkleSignals, factor: float) -> AnkleSignals:
    return leg._replace(gyr=factor * leg.gyr, gyr_bias=factor * leg.gyr_bias)
