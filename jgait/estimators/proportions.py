"""Measures of a person from the body height, by published proportions; for measures that nobody took with a tape.

Source: R. Drillis, R. Contini, "Body segment parameters", 1966, as usual in biomechanics: thigh 0.245 and shank 0.246
of the height. Chosen: segments of adults of one height differ by 1 % of the height (one standard deviation).
"""

import math
from collections.abc import Collection, Mapping

from jaxtyping import PyTree

from jgait.notes import DEFAULT_MEASURE, Kind, Note

SHARES = {"thigh_length": 0.245, "shank_length": 0.246, "lever_shank": 0.103}
"""Measure → its share of the body height [1]. A sensor at mid shank is taken to sit 0.18 m over the ankle of a person
of 1.75 m, the default of `ankle_stride`."""

SHARE_SD = 0.01
"""[1] Standard deviation of a segment's length among people of one height, over the height."""

SENSOR_SHARE, SENSOR_SD = 0.6, 0.02
"""[1] Height of a sensor at the waist over the person's height, two people of `mobgap_lab` have 0.606 and 0.617; and
[m] its standard deviation. The waist's estimator takes the body height itself."""

HEIGHTS = (0.8, 2.4)
"""[m] Smallest and largest height of a person that is accepted."""

FROM_HEIGHT = Kind(
    "measures_from_height", "info", "from the height of {height:.2f} m, by usual proportions: {measures}",
    f"{DEFAULT_MEASURE} Standard deviations include how much people of one height differ.",
)  # fmt: skip

HEIGHT_ABSENT = Kind(
    "height_absent", "check", "the person's height is not given, nor {measures}: those of a usual adult are taken, and "
    "deviations hold for adults alone",
    f"{DEFAULT_MEASURE} Lengths and distance of a child by a waist's sensor are then too large by half and more, and "
    "so is the distance by thighs and shanks.",
)  # fmt: skip


def outside(name: str, value: float, low: float, high: float) -> str:
    """The sentence about a measure in metres outside its range, with the unit that may have been meant; else ""."""
    if low <= value <= high:
        return ""
    # nobody measures a part of a person in parts of a centimetre
    units = (("cm", 100.0), ("mm", 1000.0)) if value >= 1.0 else ()
    meant = [f" (in {unit}? then {value / many:g})" for unit, many in units if low <= value / many <= high]
    hint = ": leave out what is unknown" if math.isnan(value) else (meant or [""])[0]
    return f"{name} must be between {low:g} and {high:g} m; got {value:g}{hint}"


def gives(wanted: Collection[str]) -> bool:
    """Whether the height gives any of the measures."""
    return any(name in wanted for name in SHARES)


def in_metres(body: Mapping[str, PyTree]) -> dict[str, PyTree]:
    """The measures of a person by their names, without the unit that columns of tables have behind them ("height_m").

    Raises ValueError if a measure is given under both names.
    """
    known = {name.removesuffix("_m"): value for name, value in body.items()}
    if len(known) < len(body):
        twice = next(name for name in body if f"{name}_m" in body)
        raise ValueError(f"a person has one {twice}; got {twice!r} and '{twice}_m'")
    return known


def with_proportions(body: Mapping[str, PyTree], wanted: Collection[str]) -> dict[str, PyTree]:
    """The measures of a person, with those of the `wanted` ones that follow from "height" [m].

    A height that is not wanted is left out, unless no wanted measure follows from it. Raises ValueError if the height
    is outside `HEIGHTS`.
    """
    known = in_metres(body)
    height = known.get("height")
    if height is None or not gives(wanted):
        return known
    if isinstance(height, int | float) and (wrong := outside("height", height, *HEIGHTS)):
        raise ValueError(wrong)
    if "height" not in wanted:
        del known["height"]
    return {name: share * height for name, share in SHARES.items() if name in wanted} | known


def height_notes(body: Mapping[str, PyTree], wanted: Collection[str]) -> tuple[Note, ...]:
    """The note about measures that follow from the height, or about a missing height; empty if none is needed."""
    made = [name for name in SHARES if name in wanted and name not in body]
    sensor = "sensor_height" in wanted and "sensor_height" not in body
    if not (made or sensor):
        return ()
    levers = {"lever_shank": "height of the shank's sensor over the ankle"}
    words = [levers.get(name, name.replace("_", " ")) for name in made] + ["height of the waist's sensor"] * sensor
    height = body.get("height")
    if height is None:
        return (HEIGHT_ABSENT(measures=words),)
    shares = [(SHARES[name], SHARE_SD * height) for name in made] + [(SENSOR_SHARE, SENSOR_SD)] * sensor
    return (FROM_HEIGHT(height=height, measures=[
        f"{word} {share * height:.2f} ± {sd:.2f} m" for word, (share, sd) in zip(words, shares, strict=True)
    ]),)  # fmt: skip
