"""Permitted ranges of a person and a gait: each error names the limit."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from jgait.geometry.segments import segment_of
from jgait.simulate.person import DEGREE, Body, Gait, Person
from jgait.simulate.sensors import ImuErrors, check_errors
from jgait.simulate.sensors.imu import check_fields
from jgait.simulate.shapes import STYLES
from jgait.simulate.walker import Slack
from jgait.types import check_kind, check_number

_RANGES: dict[str, tuple[float, float]] = {
    **dict.fromkeys(("thigh_length", "shank_length"), (0.1, 0.8)),
    "hip_width": (0.02, 0.6), "ankle_height": (0.01, 0.2), "ball_length": (0.02, 0.4), "heel_length": (0.0, 0.2),
    "toe_length": (0.0, 0.2), "stride_length": (0.1, 3.0), "stride_time": (0.4, 5.0), "stance_fraction": (0.25, 0.8),
    "step_width": (0.0, 0.6), "toe_out": (-45.0 * DEGREE, 45.0 * DEGREE), "toe_up": (0.0, 60.0 * DEGREE),
    "heel_up": (0.0, 120.0 * DEGREE), "foot_flat": (0.02, 0.2), "heel_off": (0.1, 0.5), "swing_lift": (0.0, 0.3),
    "landing_speed": (0.0, 1.0), "knee_stance": (1.0 * DEGREE, 60.0 * DEGREE),
    "pelvis_rise": (-0.15, 0.15), "pelvis_lag": (-0.5, 0.5),
    "standing_hip": (-30.0 * DEGREE, 30.0 * DEGREE), "standing_knee": (0.5 * DEGREE, 60.0 * DEGREE),
    "hip_ahead": (-0.3, 0.3), "stiff": (-1.0, 1.0),
    "steps": (1.0, 2000.0),
    **dict.fromkeys(STYLES, (-4.0, 4.0)), "recorded": (0.0, 1.0),
    **dict.fromkeys(("length_asymmetry", "time_asymmetry"), (-0.5, 0.5)),
    **dict.fromkeys(("length_variability", "time_variability", "pitch_variability"), (0.0, 0.15)),
    "persistence": (0.0, 0.95), "right_first": (0.0, 1.0),
}  # fmt: skip
"""Closed ranges of the fields, in their units; fields not listed must not be negative."""


def check_values(person: Person) -> None:
    """Check the values of a person; whether the legs are long enough depends on the route, see `check_slack`.

    Raises TypeError if a field is not a number, and ValueError if a field lies outside its range, or the times of a
    stride contradict each other.
    """
    if not (isinstance(person, Person) and isinstance(person.body, Body) and isinstance(person.gait, Gait)):
        raise TypeError(f"a person is Person(body=Body(…), gait=Gait(…)); got {person!r}")
    for part in person:
        for name, value in zip(part._fields, part, strict=True):
            if np.ndim(value) != 0:
                raise TypeError(f"{type(part).__name__}.{name} must be one number; got {value!r}")
        check_fields(part, _RANGES)
    gait = person.gait
    if float(gait.steps) != round(float(gait.steps)):
        raise ValueError(f"Gait.steps must be a whole number; got {float(gait.steps):g}")
    if not gait.foot_flat < gait.heel_off < gait.stance_fraction - 0.05:
        raise ValueError(
            "a foot lies flat, lifts its heel and leaves in this order: Gait.foot_flat < heel_off < stance_fraction − "
            f"0.05; got {float(gait.foot_flat):g}, {float(gait.heel_off):g}, {float(gait.stance_fraction):g}"
        )


def check_sensors(errors: ImuErrors, rate: float, placements: Sequence[str]) -> None:
    """Check the errors, the sampling rate and the placements of sensors.

    Raises TypeError or ValueError if the sensors cannot err like that, the rate [Hz] is not positive, or a placement is
    not on the simulated body.
    """
    check_kind(errors, ImuErrors, "errors must be ImuErrors, such as jgait.simulate.sensors.MPU6000")
    check_errors(errors)
    check_number(rate, "rate must be a number of samples per second")
    if not (math.isfinite(rate) and rate > 0.0):
        raise ValueError(f"rate must be a positive number of samples per second; got {rate!r}")
    if isinstance(placements, str) or not placements:
        raise ValueError(f"placements must be one or more names in a list, such as ['foot_right']; got {placements!r}")
    for placement in placements:
        segment_of(placement)


def check_places(places: Mapping[str, Sequence[float]] | None, placements: Sequence[str]) -> None:
    """Check that places of sensors are three numbers each, below a metre, and belong to placements; else ValueError."""
    for name, place in (places or {}).items():
        if name not in placements:
            raise ValueError(f"places has {name!r}, which is not among the placements {', '.join(placements)}")
        numbers = np.asarray(place)
        if numbers.dtype.kind not in "if" or numbers.shape != (3,) or not np.all(np.abs(numbers) < 1.0):
            raise ValueError(f"places[{name!r}] must be three numbers in m, each below 1 in size; got {place!r}")


def check_slack(person: Person, left: Slack, where: str) -> None:
    """Raise ValueError if an ankle comes too far from below the hip, or a leg is overstretched, on the route of which
    `where` is the description.
    """
    gait, leg, most = person.gait, person.body.thigh_length + person.body.shank_length, 0.75
    if not float(left.aside) < most:
        raise ValueError(
            f"legs of {leg:.3f} m are too short for strides of {gait.stride_length:.3f} m {where}: an ankle would be "
            f"{float(left.aside):.2f} of the leg's length from below the hip (at most {most}); "
            "shorten stride_length or lengthen thigh_length and shank_length"
        )
    if not float(left.stretched) > 0.0:
        raise ValueError(
            f"a leg of {leg:.3f} m would be overstretched by {-1e3 * float(left.stretched) * leg:.1f} mm {where}; "
            "raise knee_stance, shorten stride_length or lower the stairs"
        )
