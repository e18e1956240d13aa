"""Gaits that are not the usual one, as changes of a person's gait.

They change footholds, times and paths of the feet, and the motion of the pelvis; legs follow.
"""

from collections.abc import Mapping
from typing import NamedTuple

from jgait.simulate.person import DEGREE, Person
from jgait.simulate.population import paced


class OtherGait(NamedTuple):
    """How a gait differs from the usual one."""

    length: float  #: length of the stride over that of the person's usual stride [1].
    time: float  #: duration of the stride over that of the usual one [1].
    fields: Mapping[str, float] = {}  #: other fields of `Gait` → value in their units.


GAITS = {
    "slow": OtherGait(0.6, 1.45),
    "fast": OtherGait(1.15, 0.87),
    # in Parkinson's disease strides are short for their cadence (Egerton and others, BMC Neurology 12 (2012) 116)
    "shuffling": OtherGait(
        0.38, 1.05,
        {"toe_up": 2.0 * DEGREE, "heel_up": 20.0 * DEGREE, "swing_lift": 0.008, "pelvis_rise": 0.006,
         "stance_fraction": 0.72, "foot_flat": 0.05, "heel_off": 0.5},
    ),
    # after a stroke steps differ in length and time (Wonsetler and Bowden, Top Stroke Rehabil 24 (2017) 435)
    "limping": OtherGait(0.7, 1.15, {"length_asymmetry": 0.2, "time_asymmetry": 0.15}),
    # the right knee bends less in swing, and the leg swings outwards instead
    "stiff_leg": OtherGait(0.8, 1.15, {"stiff": 0.9, "recorded": 0.0, "knee_stance": 9.0 * DEGREE}),
    "hemiparetic": OtherGait(  # a stiff leg with steps as in limping
        0.55, 1.3,
        {"stiff": 0.6, "recorded": 0.0, "knee_stance": 9.0 * DEGREE, "length_asymmetry": 0.15, "time_asymmetry": 0.2,
         "step_width": 0.16},
    ),
    "unsteady": OtherGait(
        0.75, 1.15,
        {"step_width": 0.25, "length_variability": 0.08, "time_variability": 0.06, "width_variability": 0.04},
    ),
    "crouched": OtherGait(0.75, 1.1, {"knee_stance": 30.0 * DEGREE}),
    # a foot leaves the ground after 39 % of the stride (Novacheck, Gait Posture 7 (1998) 77)
    "running": OtherGait(
        1.25, 0.68,
        {"stance_fraction": 0.39, "foot_flat": 0.04, "heel_off": 0.17, "toe_up": 15.0 * DEGREE,
         "heel_up": 85.0 * DEGREE, "swing_lift": 0.12, "knee_stance": 16.0 * DEGREE, "hip_ahead": 0.26,
         "pelvis_rise": -0.06, "pelvis_surge": 0.01, "pelvis_lag": -0.15, "step_width": 0.04, "recorded": 0.0},
    ),
    "toes_out": OtherGait(0.9, 1.0, {"toe_out": 25.0 * DEGREE}),
}  # fmt: skip
"""Gaits by name; the sizes are chosen, and feet and pelvis follow the stride, see `population.manner`."""


def walking(person: Person, gait: str) -> Person:
    """The same person in another gait; how soft tissue moves in it is not known, so sensors are fixed to bones.

    Raises:
        ValueError: if `GAITS` has no such gait.
    """
    if gait not in GAITS:
        raise ValueError(f"a gait is one of {', '.join(GAITS)}; got {gait!r}")
    other = GAITS[gait]
    body, follows = paced(person, other.length)
    seconds = person.gait.stride_time * other.time
    return Person(body, follows._replace(stride_time=seconds, soft_tissue=0.0, **other.fields))
