"""The zero of hip and knee angles where a recording begins standing, on a chair, or in mid-walk.

Each walk is cut or lengthened: as it is; from a second and a half after its first step to half a second before its
last, so that nobody stands; and behind five seconds on a chair and a rise that ends as the first step begins. Simulated
people stand with hips and knees that differ more than those of `simulate.population`. Offsets are means over the walk
of estimated less true angles: of simulation, of Vicon (`neura_sparse`), and on `walking5m` those of the whole
recording, counted from standing. Nothing is learned on those judged but the rounded numbers of the usual pose.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np

from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from experiments.unseen2.turned import FOUR
from jgait import simulate
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf.prepare import resting_legs
from jgait.geometry.vectors import GRAVITY
from jgait.mounting.cycle import walking
from jgait.mounting.leg import SegmentMounting, WornLegs, worn_legs
from jgait.simulate.sensors import MPU6000
from jgait.types import SIDES, Imu, Recording, as_float

STARTS = ("standing", "sitting", "mid-walk")
SITS_S, RISES_S, CHAIR_DEG = 5.0, 1.6, {"thigh": 82.0, "shank": -8.0}
"""[s] Duration of sitting and of the rise; [deg] inclinations of the segments on the chair."""

STANDING_SD_DEG = {"hip": 2.5, "knee": 2.5}
"""[deg] Standard deviations of simulated standing poses, beside the 1.5 of `simulate.population`."""

JOINTS = ("hip_angle", "knee_angle")


class Case(NamedTuple):
    """A walk with known angles."""

    group: str
    recording: Recording
    truth: dict[str, np.ndarray]  #: side → (2, T) hip and knee [rad], NaN where not known.
    walks: np.ndarray  #: (T,) bool.
    worn: WornLegs


class Offset(NamedTuple):
    """The error of the zero of one joint."""

    group: str
    start: str
    joint: str
    error: float  #: [deg]
    stddev: float  #: [deg]


def cased(group: str, recording: Recording, truth: dict[str, np.ndarray]) -> Case:
    """A walk of a person who stands at first."""
    _, sensors, _, still = resting_legs(recording, leg_ekf.DEFAULT)
    rate = recording.sampling_rate_hz
    worn = worn_legs(sensors, still, rate, estimator="leg_ekf")
    return Case(group, recording, truth, walking(sensors, rate) & ~still, worn)


def simulated(people: int, seed: int) -> Iterator[Case]:
    """Simulated walks of 12 m."""
    key, rng = jax.random.key(seed), np.random.default_rng(seed)
    drawn = simulate.population(key, people)
    errors, along = MPU6000._replace(packet_loss=0.0), simulate.straight(12.0)
    for number in range(people):
        person, each = simulate.person_of(drawn, number), jax.random.fold_in(key, number)
        hip, knee = (np.deg2rad(STANDING_SD_DEG[joint]) * rng.standard_normal() for joint in ("hip", "knee"))
        gait = person.gait._replace(
            standing_hip=person.gait.standing_hip + hip, standing_knee=max(0.02, person.gait.standing_knee + knee)
        )
        able = simulate.covering(each, simulate.Person(person.body, gait), along)
        recording, true = simulate.recording(each, able, along, errors, placements=FOUR)
        legs = {side: np.stack([as_float(getattr(getattr(true.estimate.legs, side), j)) for j in JOINTS])
                for side in SIDES}  # fmt: skip
        yield cased("simulated", recording, legs)


def public(quick: bool) -> Iterator[Case]:
    """Public walks of people who stand at first."""
    for name in ("walking5m", "neura_sparse"):
        if not available(name):
            continue
        for walk in walks(name, names(name)[:2] if quick else None):
            recording = walk.recording._replace(sensors={k: walk.recording.sensors[k] for k in FOUR})
            if name == "neura_sparse":
                assert walk.reference is not None
                legs = {side: np.stack([as_float(getattr(getattr(walk.reference.legs, side), j)) for j in JOINTS])
                        for side in SIDES}  # fmt: skip
                yield cased(name, recording, legs)
                continue
            estimate = attempt(recording.name, lambda r=recording: leg_ekf.estimate(leg_ekf.LegParams(), r))
            if estimate is None:
                continue
            stands, truth = slice(*estimate.diagnostics["standing"]), {}
            for side in SIDES:
                angles = np.stack([as_float(getattr(getattr(estimate.legs, side), j)) for j in JOINTS])
                truth[side] = angles - angles[:, stands].mean(axis=1, keepdims=True)
            yield cased(name, recording, truth)


def begun(case: Case, start: str) -> tuple[Recording, int, int]:
    """The recording with a start, and which samples of the walk (first, after) are its last ones."""
    rate = case.recording.sampling_rate_hz
    if start == "standing":
        return case.recording, 0, len(case.walks)
    moving = np.flatnonzero(case.walks)
    assert case.worn.standing is not None
    first = moving[0] + round(1.5 * rate) if start == "mid-walk" else case.worn.standing[1] + round(0.2 * rate)
    after = moving[-1] - round(0.5 * rate)
    sensors = {}
    for side, leg in case.worn.legs.items():
        for segment, mounting in leg.segments.items():
            imu = case.recording.sensors[mounting.placement]
            gyr, acc = as_float(imu.gyr)[first:after], as_float(imu.acc)[first:after]
            if start == "sitting":
                on_chair = chair(segment, mounting, rate)
                gyr, acc = (np.concatenate(pair) for pair in zip(on_chair, (gyr, acc), strict=True))
            time = np.arange(len(gyr)) / rate
            sensors[f"{segment}_{side}"] = Imu(time, gyr, acc, np.ones(len(gyr), bool))
    return case.recording._replace(sensors=sensors), int(first), int(after)


def chair(segment: str, mounting: SegmentMounting, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Angular rate and specific force (T, 3) of a sensor on a person who sits and rises."""
    rng = np.random.default_rng(0)
    share = np.linspace(0.0, 1.0, round(RISES_S * rate))
    angle = np.concatenate([np.ones(round(SITS_S * rate)), 1.0 - share**3 * (10.0 - 15.0 * share + 6.0 * share**2)])
    angle = np.deg2rad(CHAIR_DEG[segment]) * angle
    force = GRAVITY / mounting.scale * np.stack([np.sin(angle), np.zeros(len(angle)), np.cos(angle)], axis=1)
    acc = force @ mounting.axes
    gyr = mounting.bias @ mounting.axes - np.outer(np.gradient(angle, 1.0 / rate), mounting.axes[1])
    return gyr + 0.002 * rng.standard_normal(gyr.shape), acc + 0.03 * rng.standard_normal(acc.shape)


def offsets(case: Case, start: str) -> list[Offset]:
    """The errors of the zeros of hips and knees."""
    recording, first, after = begun(case, start)
    estimate, out = leg_ekf.estimate(leg_ekf.LegParams(), recording), []
    last = len(estimate.time) - (after - first)
    for side in SIDES:
        truth = case.truth[side][:, first:after]
        zeros = as_float(estimate.diagnostics[f"zero_stddev_{side}"])
        for joint, angles, spread in zip(JOINTS, truth, zeros, strict=True):
            angle = as_float(getattr(getattr(estimate.legs, side), joint))[last:][: angles.size]
            kept = case.walks[first:after][: angle.size] & np.isfinite(angles[: angle.size])
            error = float(np.mean((angle - angles[: angle.size])[kept]))
            out.append(Offset(case.group, start, joint.partition("_")[0], np.rad2deg(error),
                              np.rad2deg(float(spread))))  # fmt: skip
    return out


def rows(quick: bool) -> list[Row]:
    """Offsets over stated deviations."""
    made: list[Offset] = []
    for case in [*simulated(2 if quick else 24, 7), *public(quick)]:
        for start in STARTS:
            made += attempt(f"{case.recording.name}, {start}", lambda c=case, s=start: offsets(c, s)) or []
    return of_offsets(made)


def of_offsets(made: list[Offset]) -> list[Row]:
    """Shares within two stated deviations, by set and start."""
    if not made:
        return []
    lines = []
    for joint in ("knee", "hip"):
        for group in dict.fromkeys(one.group for one in made):
            for start in STARTS:
                some = [one for one in made if (one.group, one.start, one.joint) == (group, start, joint)]
                if some:
                    errors, spread = (np.array([getattr(one, key) for one in some]) for key in ("error", "stddev"))
                    lines.append([f"{joint}, {group}, {start}", len(some), float(np.mean(errors)),
                                  float(np.median(np.abs(errors))), float(np.max(np.abs(errors))),
                                  float(np.median(spread)), within(some)])  # fmt: skip
    columns = ["", "n", "mean error °", "median |error| °", "worst °", "stated °", "in 2 sd %"]
    show("Zero of the joint angles", columns, lines)
    out = []
    for joint in ("knee", "hip"):
        some = [one for one in made if one.joint == joint]
        line = f"legs, zero of the {joint} after standing, sitting and in mid-walk"
        typical = float(np.median([abs(one.error) for one in some]))
        out += [
            Row(f"{joint}_zero_two_sigma_pct", within(some), "%", n=len(some), split="prior of other sets").on(
                f"{line}: within two stated deviations", "", "legs"
            ),
            Row(f"{joint}_zero_error_deg", typical, "deg", n=len(some), split="prior of other sets").on(
                f"{line}: error", "median", "legs"
            ),
            Row(f"{joint}_zero_worst_deg", max(abs(one.error) for one in some), "deg", n=len(some),
                split="prior of other sets").on(f"{line}: error", "worst", "legs"),
        ]  # fmt: skip
    return out


def within(some: list[Offset]) -> float:
    """Share of offsets within two stated deviations [%]."""
    return 100.0 * float(np.mean([abs(one.error) <= 2.0 * one.stddev for one in some]))
