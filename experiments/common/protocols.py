"""The walking protocols of the papers, performed by simulated people: one call for each paper.

Every function draws people from `simulate.population`, changes them as in its paper, and scales their strides so that a
whole number of steps covers the route exactly. Values that a paper does not state are chosen here and marked as chosen.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import PRNGKeyArray

from jgait import simulate
from jgait.geometry.vectors import GRAVITY
from jgait.simulate import Person, Route, Truth
from jgait.simulate.ranged import SKIN
from jgait.simulate.sensors import DEGREE, IDG300, MPU6000, OPAL, ImuErrors
from jgait.types import Recording


class Walked(NamedTuple):
    """One walk of a protocol.

    Attributes:
        recording: readings of the worn sensors.
        truth: the reference of the walk; `truth.estimate` has the type of an estimate.
        extra: name → further measurements and settings; see the protocol.
    """

    recording: Recording
    truth: Truth
    extra: dict[str, Any]


def _keys(key: PRNGKeyArray, people: int) -> tuple[list[Person], list[PRNGKeyArray], list[PRNGKeyArray]]:
    """People, a key for the walk of each person, and a key of each person for other random values."""
    who, how, other = jax.random.split(key, 3)
    drawn = simulate.population(who, people, recorded=False)
    numbers = range(people)
    walks, others = ([jax.random.fold_in(k, i) for i in numbers] for k in (how, other))
    return [simulate.person_of(drawn, i) for i in numbers], walks, others


def _walked(
    keys: Sequence[PRNGKeyArray], people: Sequence[Person], along: Sequence[Route], errors: ImuErrors, rate: float,
    placements: Sequence[str], name: str,
) -> list[Walked]:  # fmt: skip
    """Fit each person to the route, and simulate the walks."""
    fit = [simulate.covering(*one) for one in zip(keys, people, along, strict=True)]
    names = [f"{name}_{i + 1:04d}" for i in range(len(fit))]
    walked = simulate.walks(keys, fit, along, errors, rate, placements, names=names)
    lengths = [float(np.sum(route.length)) for route in along]
    return [
        Walked(recording, truth, {"distance": length, "steps": round(person.gait.steps), "person": person})
        for (recording, truth), length, person in zip(walked, lengths, fit, strict=True)
    ]


SHORTEST, LONGEST = 3.1, 4.0
"""[m] Distances of Bennett's walks are uniform between these; chosen, with the mean of the paper."""


def bennett(
    key: PRNGKeyArray, people: int = 1, *, errors: ImuErrors = IDG300, rate: float = 50.0,
    placements: Sequence[str] = simulate.FOUR,
) -> list[Walked]:  # fmt: skip
    """A straight walk of 3 to 4 m with quiet standing, feet parallel, at both ends; thigh and shank at 50 Hz.

    `people` is the number of people; other arguments as of `simulate.recording`.

    Returns:
        The walks; `extra` holds the true distance [m], the steps and the person.

    Source: Bennett, Jafari and Gans, "An extended Kalman filter to estimate human gait parameters and walking
    distance": section IV-A (gyroscopes, 50 Hz), IV-B (thigh and shin; only the right leg, here both), V (between 3 and
    4 m, 3.55 m on average; standing with feet parallel).
    """
    persons, walks, others = _keys(key, people)
    drawn = [float(jax.random.uniform(other, minval=SHORTEST, maxval=LONGEST)) for other in others]
    return _walked(walks, persons, [simulate.straight(d) for d in drawn], errors, rate, placements, "bennett")


MOTE = IDG300._replace(acc_range=2.0 * GRAVITY, acc_resolution=GRAVITY / 1024.0)
"""The mote of Udaya Shankar and others: as `IDG300`, its accelerometer set to ±2 g in 1024 steps per g."""


def udaya_shankar(
    key: PRNGKeyArray, people: int = 1, duration: float = 14.0, *, errors: ImuErrors = MOTE, rate: float = 50.0,
    placements: Sequence[str] = ("thigh_right", "shank_right"),
) -> list[Walked]:  # fmt: skip
    """A straight walk at constant speed for at least `duration` [s], standing not counted; thigh and shank of the right
    leg at 50 Hz.

    Other arguments and `extra` as `bennett`.

    Raises:
        ValueError: if `duration` is not positive.

    Source: Udaya Shankar, Raveendranathan, Gans and Jafari, "Towards power optimized Kalman filter for gait assessment
    using wearable sensors": section 3.1 (±2 g at 1024 steps per g, IDG-300, 50 Hz), 4.1 (right leg, thigh and just
    below the knee; here the middle of the shank). Chosen: the duration, and that it is straight.
    """
    if not (math.isfinite(duration) and duration > 0.0):
        raise ValueError(f"duration must be a positive number of seconds; got {duration!r}")
    persons, walks, _ = _keys(key, people)
    # One step more, because the times of the steps vary.
    counts = [math.ceil(2.0 * duration / p.gait.stride_time) + 1 for p in persons]
    along = [simulate.straight(0.5 * n * p.gait.stride_length) for n, p in zip(counts, persons, strict=True)]
    return _walked(walks, persons, along, errors, rate, placements, "udaya_shankar")


BEND = 1.0
"""Radius of the corners of Silva's routes [m]; chosen."""


def silva_route(name: str) -> Route:
    """The three routes of Silva, Afonso and Rocha: 127.6 m straight, 42.05 m round a hall, 136.1 m with stairs.

    Only the total lengths are printed. Chosen: on A the outward and the return walk form one straight line, because
    nobody turned while walking; B is one lap round a hall, with sides of 13 m and the rest; C has five corners, 5.6 m
    of stairs up and as much down (a riser of 0.15 m at every step, half the speed: some 13 to 16 of them), and ramps of
    4 % for irregular pavement.

    Raises:
        ValueError: if there is no such route.
    """
    quarter = {"length": 0.5 * math.pi * BEND, "turn": 0.5 * math.pi}
    right = {**quarter, "turn": -0.5 * math.pi}
    if name == "A":
        return simulate.straight(127.6)
    if name == "B":
        long = 13.0 - 2.0 * BEND
        short = 0.5 * (42.05 - 2.0 * long - 4.0 * quarter["length"])
        return simulate.route(*(piece for side in (long, short) * 2 for piece in ({"length": side}, quarter)))
    if name == "C":
        stairs = {"length": 5.6, "speed": 0.5}
        fixed: list[dict[str, float]] = [
            {"length": 25.0}, quarter, {"length": 8.0}, {**stairs, "riser": 0.15}, {"length": 6.0}, quarter,
            {"length": 12.0, "slope": 0.04}, {"length": 12.0, "slope": -0.04}, right, {"length": 20.0}, quarter,
            {**stairs, "riser": -0.15}, {"length": 10.0}, quarter,
        ]  # fmt: skip
        return simulate.route(*fixed, {"length": 136.1 - sum(piece["length"] for piece in fixed)})
    raise ValueError(f"the routes of Silva are A, B and C; got {name!r}")


FAST = 1.2
"""[1] Factor by which the strides of Silva's fast pace are longer, and quicker, than those of the normal pace.

From the paper's counts of strides, Table I: normal over fast is 1.26 and 1.31 on route 1, 1.14 and 1.22 on route 2,
1.07 and 1.11 on route 3.
"""


def silva(
    key: PRNGKeyArray, people: int = 1, route: str = "A", speed: str = "normal", *, errors: ImuErrors = MPU6000,
    rate: float = 100.0, placements: Sequence[str] = ("ankle_right",),
) -> list[Walked]:  # fmt: skip
    """One of three routes at one of two paces; the right ankle at 100 Hz.

    The same people walk every route ("A", "B" or "C", see `silva_route`: 1, 2 and 3 of the paper) at both paces
    ("normal" or "fast"). Other arguments and `extra` as `bennett`.

    Raises:
        ValueError: if there is no such route or pace.

    Source: Silva, Afonso and Rocha, "Walk distance estimation using an ankle-mounted inertial measurement unit",
    section II-C (MPU-6000 at the right ankle, lateral side, 100 Hz; routes 1 to 3, normal and fast), Table I.
    """
    if speed not in ("normal", "fast"):
        raise ValueError(f"speed must be 'normal' or 'fast'; got {speed!r}")
    along = silva_route(route)
    persons, walks, _ = _keys(key, people)
    if speed == "fast":
        persons = [jax.tree.map(float, simulate.paced(person, FAST)) for person in persons]
    return _walked(walks, persons, [along] * people, errors, rate, placements, f"silva_{route}_{speed}")


def potter(
    key: PRNGKeyArray, people: int = 1, *, errors: ImuErrors = OPAL, rate: float = 128.0,
    placements: Sequence[str] = ("foot_right", "foot_left"), straight: float = 50.0, after: float = 25.0,
) -> list[Walked]:  # fmt: skip
    """50 m, a corner of 90°, 25 m, on marks 0.30 m apart sideways and 0.61 m forward; both feet, and a range.

    The range sensor sits on the inner side of the left ankle and points at the right leg. Distances `straight` and
    `after` the corner are in m; other arguments as `bennett`.

    Returns:
        The walks, with `feet_range` in their recordings; `extra` as in `bennett`, and the true distance between the
        skin of both legs `range_distance` (T,) [m], `offset`, the distance of the shanks' axes minus that of the skin
        [m], and `corner`, the distances along the route at which the corner begins and ends (2,) [m].

    Source: Potter's filter for stride width: section III-A (Opal on each instep, 128 Hz; HC-SR04 at the left ankle, 30
    Hz), III-B (50 m, 90°, 25 m; tiles that make a width of 0.30 m and steps of 0.61 m). Chosen: the radius of the
    corner (0.8 m) and its side, 5 mm of variability, cadence by each person's own walk ratio.
    """
    persons, walks, others = _keys(key, people)
    along = simulate.corner(straight, 0.5 * math.pi, after)
    marked = []
    for drawn in persons:
        paced = jax.tree.map(float, simulate.paced(drawn, 1.22 / drawn.gait.stride_length))
        onto = {"step_width": 0.30, "length_variability": 0.005 / 0.61, "width_variability": 0.005,
                "length_asymmetry": 0.0}  # fmt: skip
        marked.append(Person(paced.body, paced.gait._replace(**onto)))
    walked = _walked(walks, marked, [along] * people, errors, rate, placements, "potter")
    corner = (straight, straight + float(along.length[1]))
    found = []
    for other, walk in zip(others, walked, strict=True):
        read, apart = simulate.feet_range(other, walk.truth)
        extra = {**walk.extra, "range_distance": apart, "offset": 2.0 * SKIN, "corner": corner}
        found.append(walk._replace(recording=walk.recording._replace(feet_range=read), extra=extra))
    return found


SIDEWAYS = 2.0 * math.pi / 3.0 / math.sqrt(3.0)

FREESENSE = ImuErrors(
    gyr_noise=0.03 * DEGREE,
    gyr_bias=0.5 * DEGREE,
    gyr_drift=0.01 * DEGREE,
    gyr_scale=0.01,
    gyr_range=500.0 * DEGREE,
    gyr_resolution=0.2441 * DEGREE,
    acc_noise=300e-6 * GRAVITY,
    acc_bias=0.02 * GRAVITY,
    acc_scale=0.01,
    acc_range=2.0 * GRAVITY,
    acc_resolution=0.0096,
    mounting=5.0 * DEGREE,
)
"""A Sensorize FreeSense at the waist, sampled at 100 Hz.

Printed by Köse, Cereatti and Della Croce: steps of 0.0096 m/s² and 0.2441 °/s, 100 Hz. Worked out from them: ±2 g and
±500 °/s are 4096 such steps, so a 12-bit converter. Chosen: everything else.
"""

RIGHT_SIDE = FREESENSE._replace(mounting_x=SIDEWAYS, mounting_y=SIDEWAYS, mounting_z=-SIDEWAYS)
"""A FreeSense in the orientation in which it is worn: x axis down, y forward, z to the right."""


def kose(
    key: PRNGKeyArray, people: int = 1, *, errors: ImuErrors = RIGHT_SIDE, rate: float = 100.0,
    speeds: Sequence[float] = (1.0, 1.15, 1.3), piece: float = 25.0, placements: Sequence[str] = ("waist",),
) -> list[Walked]:  # fmt: skip
    """75 m straight, faster after every 25 m (`piece`); a sensor on the right side of the waist at 100 Hz.

    `speeds` of the pieces are over the person's self-selected speed [1]; other arguments and `extra` as `bennett`.

    Source: Köse, Cereatti and Della Croce, "Estimation of traversed distance in level walking using a single inertial
    measurement unit attached to the waist": section 2.2a (FreeSense, 100 Hz, right side, axes), 2.2b (dataset B: 75 m
    straight, from the self-selected speed, raised every 25 m). Chosen: by how much it is raised, 15 % each time.
    """
    persons, walks, _ = _keys(key, people)
    along = simulate.faster(piece, *speeds)
    return _walked(walks, persons, [along] * people, errors, rate, placements, "kose")
