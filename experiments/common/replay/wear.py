"""Sensors on a replayed body, and the truth in the type of an estimate."""

import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from experiments.common.replay.body import JointCentres, LegCentres, Replay, body_motion, median
from experiments.common.replay.spline import CUTOFF_HZ, MAX_GAP, checked_time, covered, evaluate
from jgait.geometry.sagittal import leg_in_plane, low_pass_heading
from jgait.geometry.segments import Motion, in_segment, inertial, segment_of
from jgait.geometry.vectors import Vector
from jgait.types import SIDES, Estimate, Imu, Legs, LegTrajectory, Recording, as_float

_PLACES = ("pelvis", *(f"{part}_{side}" for part in ("thigh", "shank", "ankle", "foot") for side in SIDES))
_BEHIND = 0.1  # [m] distance of the pelvis' sensor behind the middle of the hips
_ABOVE = 0.05  # [m] height of the foot's sensor above the middle of heel and toe
_SHARE = {"thigh": 0.5, "shank": 0.5, "ankle": 0.9}  # [1] position along the bone, from its proximal end

_inertial = jax.jit(jax.vmap(inertial))


def replay(
    points: JointCentres,
    rate_hz: float,
    *,
    placements: Sequence[str] | None = None,
    cutoff_hz: float = CUTOFF_HZ,
    noise: float | None = None,
    max_gap: float = MAX_GAP,
) -> tuple[Recording, Estimate]:
    """The readings of perfect sensors on this body, and the truth at the same times.

    For readings with errors, pass those of a sensor on to `jgait.simulate.sensors.measure`. `placements` None: pelvis,
    thigh, shank, ankle and foot, as far as measured. Samples in gaps longer than `max_gap` are masked. Other settings
    as of `body_motion`.

    Returns:
        The recording, each sensor in the axes of its segment (x forward, y left, z up), and the truth: legs in the
        sagittal plane, the length of the hips' path; its diagnostics hold the heading (T,) [rad], lengths of
        the segments [m], and for each point the spline's residual [m] and cut-off [Hz].

    Raises:
        ValueError: if the points are malformed, or a placement cannot be had.
    """
    if not 0.0 < rate_hz < math.inf:
        raise ValueError(f"rate_hz must be positive; got {rate_hz:g}")
    start, end = checked_time(points.time)[[0, -1]]
    time = np.minimum(start + np.arange(math.floor((end - start) * rate_hz + 1e-6) + 1) / rate_hz, end)
    if len(time) < 10:
        raise ValueError(f"{end - start:g} s at {rate_hz:g} Hz are {len(time)} samples; at least 10 are needed")
    body = body_motion(points, time, cutoff_hz=cutoff_hz, noise=noise, max_gap=max_gap)
    there = [place for place in _PLACES if getattr(body.motion.pose, segment_of(place)) is not None]
    chosen = there if placements is None else list(placements)
    lacking = [place for place in chosen if place not in there]
    if lacking or not chosen:
        raise ValueError(f"sensors can be placed at {', '.join(there)}; got {', '.join(lacking) or 'none'}")
    return Recording(_sensors(body, chosen), rate_hz, "replayed", "replayed"), _truth(points, body, rate_hz)


def mount(body: Replay, placement: str) -> np.ndarray:
    """Default position of a sensor, (3,) [m] in the segment's axes from its origin.

    Thigh and shank: on the bone, half way; ankle: at 0.9 of the shank's length; foot: 0.05 m above the middle of heel
    and toe; pelvis: 0.1 m behind the middle of the hips. Lengths are medians over the walk.
    """
    part, _, side = placement.partition("_")
    if part == "pelvis":
        return as_float([-_BEHIND, 0.0, 0.0])
    valid = getattr(body.valid, segment_of(placement))
    if part == "foot":
        middle = (body.points[f"heel_{side}"] + body.points[f"toe_{side}"]) / 2.0 - body.points[f"ankle_{side}"]
        inside = in_segment(getattr(body.motion.pose, placement), Vector(*middle.T))
        x, y, z = (median(axis, valid) for axis in inside)
        return as_float([x, y, z + _ABOVE])
    return as_float([0.0, 0.0, -_SHARE[part] * _length(body, part.replace("ankle", "shank"), side)])


def _length(body: Replay, part: str, side: str) -> float:
    ends = ("hip", "knee") if part == "thigh" else ("knee", "ankle")
    bone = body.points[f"{ends[0]}_{side}"] - body.points[f"{ends[1]}_{side}"]
    return median(np.linalg.norm(bone, axis=1), getattr(body.valid, f"{part}_{side}"))


def _sensors(body: Replay, placements: list[str]) -> dict[str, Imu]:
    places = [mount(body, placement) for placement in placements]
    frames = [[getattr(order, segment_of(placement)) for order in body.motion] for placement in placements]
    stacked: Motion[PyTree] = jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves)), *(Motion(*f) for f in frames))
    gyr, acc = (jnp.stack(felt, axis=-1) for felt in _inertial(stacked, Vector(*map(jnp.asarray, np.stack(places).T))))
    sensors = {}
    for i, placement in enumerate(placements):
        mask = getattr(body.valid, segment_of(placement))
        rate, force = (np.where(mask[:, None], as_float(signal[i]), 0.0) for signal in (gyr, acc))
        sensors[placement] = Imu(body.time, rate, force, mask)
    return sensors


def _truth(points: JointCentres, body: Replay, rate_hz: float) -> Estimate:
    from scipy.ndimage import gaussian_filter1d

    at = body.points
    diagnostics: dict[str, Any] = {}
    for name, spline in body.trajectories.items():
        diagnostics |= {f"residual_{name}": spline.residual, f"cutoff_hz_{name}": spline.cutoff_hz}
    if points.heading is not None:
        facing = at["facing"]
        heading = np.unwrap(np.arctan2(-facing[:, 0], facing[:, 1]))
    else:
        heading = low_pass_heading(body.yaw, rate_hz)
    legs: dict[str, LegTrajectory | None] = dict.fromkeys(SIDES)
    for side in SIDES:
        if getattr(points, side) is not None:
            legs[side] = leg_in_plane(at[f"hip_{side}"], at[f"knee_{side}"], at[f"ankle_{side}"], heading)
            diagnostics |= {f"{part}_length_{side}": _length(body, part, side) for part in ("thigh", "shank")}
    hips = [evaluate(body.trajectories[f"hip_{side}"], body.time).rate for side in SIDES if f"hip_{side}" in at]
    # As the reference of neura_sparse, but smoothing the velocity: a walk that starts at full speed loses no distance.
    velocity = gaussian_filter1d(np.mean(hips, axis=0)[:, :2], 0.2 * rate_hz, axis=0, mode="nearest")
    speed = np.linalg.norm(velocity, axis=1)
    path = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2.0)]) / rate_hz
    diagnostics["heading"] = heading
    valid = np.all([covered(spline, body.time) for spline in body.trajectories.values()], axis=0)
    return Estimate(body.time, Legs(legs["right"], legs["left"]), None, path, valid, diagnostics)


def from_walk(walk: PyTree) -> JointCentres:
    """The joint centres of a `Walk` of `neura_sparse`, or of any walk whose info holds them in the same way.

    Raises:
        ValueError: if the walk has no joint centres.
    """
    if walk.reference is None or "joint_centres" not in walk.info:
        raise ValueError(f"walk.info must hold 'joint_centres', and walk.reference their times; got {list(walk.info)}")
    legs = {side: LegCentres(**centres) for side, centres in walk.info["joint_centres"].items()}
    heading = walk.info.get("heading")
    return JointCentres(walk.reference.time, legs.get("right"), legs.get("left"), heading=heading)
