"""A wrong scale of a shank's rates, or of the interval between samples, detected from innovations.

With rates that are too large or too small the integrated inclination of a standing shank contradicts gravity. The NIS
of a leg is nearly a parabola of the rates' scale; its vertex is the scale that fits.
"""

from collections.abc import Callable

import numpy as np

from jgait.estimators.ankle_stride.inputs import AnkleInputs
from jgait.estimators.ankle_stride.params import AnkleOptions, AnkleParams
from jgait.estimators.interface import pad
from jgait.estimators.programs import bucket
from jgait.quality import SensorQuality
from jgait.types import SIDES, Estimate

FACTORS = (0.85, 1.0, 1.18)
"""[1] Scales of the rates for which the filter is run; one that is stated lies within 1.4 and its inverse."""

NIS_FROM, BETTER, OFF_FROM = 0.03, 0.6, 0.1
"""[1] Least NIS of a leg for which scales are tried; most good walks are below, all with rates off by 15 % above.
Limits for a wrong scale: largest NIS with the best scale over that with the scale 1, and least logarithm of the best
scale. Undamaged shanks, public and simulated, have 0.9 and 0.05; one has 0.15, but hardly a smaller NIS."""


def rates_off(
    run: Callable[..., Estimate], inputs: AnkleInputs, options: AnkleOptions, nis: dict[int, float],
    places: dict[int, str],
) -> dict[str, SensorQuality]:  # fmt: skip
    """Sensors whose rates have a wrong scale, by `ankle_stride.run` of inputs without padding.

    `nis` maps a side (0 right, 1 left) to the NIS of all observations of the leg [1], `places` to its placement.
    """
    legs = {side: leg for side, leg in enumerate((inputs.right, inputs.left)) if leg is not None}
    asked = [side for side, leg in legs.items() if nis[side] > NIS_FROM and int(leg.count) >= 4]
    if not asked:
        return {}
    each: list[list[float]] = []
    for factor in FACTORS:
        scaled = {
            SIDES[side]: leg._replace(gyr=factor * leg.gyr, gyr_bias=factor * leg.gyr_bias)
            for side, leg in legs.items()
        }
        estimate = run(AnkleParams(), pad(inputs._replace(**scaled), bucket(len(inputs.time))), options)
        each.append([float(estimate.diagnostics[f"nis_{SIDES[side]}"]) for side in asked])
    quality = {}
    for side, values in zip(asked, np.transpose(each), strict=True):
        bend, slope, _ = np.polyfit(FACTORS, values, 2)
        factor = float(np.clip(-0.5 * slope / bend, 1.0 / 1.4, 1.4)) if bend > 0.0 else 1.0
        if values.min() < BETTER * values[1] and abs(np.log(factor)) > OFF_FROM:
            quality[places[side]] = SensorQuality(rates_factor=factor, rates_off=True)
    return quality
