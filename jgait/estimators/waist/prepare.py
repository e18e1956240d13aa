"""Inputs of the waist's estimator from a recording: axes, standing, contacts, bouts. On the host, in NumPy.

This module makes the decisions: the sensor's axes, when the person stands, when which foot has its initial contact.
Decisions carry no gradient; given the decisions, `waist.run` is differentiable.
"""

import numpy as np

from jgait.estimators.checks import check_nominal_rate, check_options, common_time, longest_loss, sensors_of
from jgait.estimators.interface import Prepared, pad
from jgait.estimators.notes import (
    LONGEST_LOSS,
    NO_STEPS,
    SCALE_CORRECTED,
    SCALE_NOTED,
    STRIDES_MISSING,
    STRIDES_UNCERTAIN,
)
from jgait.estimators.programs import bucket
from jgait.estimators.waist import inputs as waist_inputs
from jgait.estimators.waist.inputs import NODES, PER_NODE, WaistInputs
from jgait.estimators.waist.motion import TrunkMotion, motion
from jgait.estimators.waist.notes import AXES_CORRECTED, GYROSCOPE_CONTRADICTS, LIES_TURNED
from jgait.estimators.waist.params import DEFAULT, DETECTORS, KNOWN, SITES, WaistOptions, WaistParams
from jgait.events import shank as shank_events
from jgait.events import trunk as trunk_events
from jgait.events.rest import BRIDGED_S, TrunkRest, trunk_rest
from jgait.geometry.rotation import level
from jgait.geometry.vectors import GRAVITY
from jgait.mounting import shank as shank_axes
from jgait.mounting import trunk as trunk_axes
from jgait.mounting.places import FORWARD_UNSURE
from jgait.mounting.trunk import TrunkAxes
from jgait.notes import Note
from jgait.quality import SensorQuality
from jgait.signal.windows import held_mean, true_runs, window_size
from jgait.types import Imu, Recording, RecordingError, as_float

NO_NODES = waist_inputs.nodes([])


def prepare(recording: Recording, options: WaistOptions = DEFAULT) -> Prepared[WaistInputs]:
    """The inputs of `waist.run` for a recording with a sensor at the waist, on the lower back or on the pelvis.

    Raises:
        RecordingError: no such sensor, no accelerometer, readings in units of g, NaN, too short, a clock that runs
            backwards, or a sampling rate that is not supported.
    """
    check_options(options, KNOWN)
    name = next((site for site in SITES if site in recording.sensors), None)
    if name is None:
        raise RecordingError(f"waist needs {' or '.join(map(repr, SITES))}; {sensors_of(recording)}")
    imu = recording.sensors[name]
    time = _checked(recording, name)
    rate = recording.sampling_rate_hz
    mask = np.asarray(imu.mask, bool) & (np.diff(time, prepend=time[0]) < 1.5 / rate)
    mask[0] = bool(np.asarray(imu.mask)[0])
    whole = shank_axes.filled(imu)
    notes: list[Note] = []
    if not mask.all():
        gone = {"samples": (~mask).sum(), "longest_s": longest_loss(~mask, time)}
        notes.append(STRIDES_UNCERTAIN(placement=name, **gone))
    for a, b in true_runs(~np.asarray(imu.mask, bool)):
        # a short loss was interpolated: zeros would be jolts, and take away the turn and the rise of its samples
        mask[a:b] |= b - a <= BRIDGED_S * rate
    axes = trunk_axes.functional_axes(whole, rate)
    if axes is None:
        up = as_float(whole.acc).mean(axis=0)
        up = up / np.linalg.norm(up)
        forward = np.cross(np.eye(3)[int(np.argmin(np.abs(up)))], up)  # any
        forward = forward / np.linalg.norm(forward)
        axes = TrunkAxes(np.stack([forward, np.cross(up, forward), up]), 0.0, 0.0)
        never = TrunkRest(np.zeros(len(time), bool), np.zeros(3), 1.0, 0.0, np.eye(3)[2], ())
        nobody = _assembled(whole, axes, time, mask, rate, never, NO_NODES)
        notes.append(NO_STEPS(placement=name))
        return Prepared(nobody, options, tuple(notes), None, quality={name: SensorQuality(unusable=True)})
    worn, whole = whole, trunk_axes.centred(whole, axes.rows, rate)
    axes = trunk_axes.functional_axes(whole, rate) or axes
    angle, over = _turned_over(whole, axes.rows[2], rate)
    if over.any():
        axes = trunk_axes.functional_axes(whole, rate, ~over) or axes
        angle, over = _turned_over(whole, axes.rows[2], rate)
    mask &= ~over
    one_pose = not over.any()
    if not axes.sure:
        _, rested, trunk, _ = _motion(whole, axes, time, mask, rate, name, [], one_pose)
        level = np.stack(trunk[:2], axis=1)[: len(time)]
        axes = trunk_axes.where_one_went(axes, level, rested.still, rate)
        whole = trunk_axes.centred(worn, axes.rows, rate)
    notes.append(AXES_CORRECTED(placement=name, **trunk_axes.worn(axes)))
    if not axes.sure:
        notes.append(FORWARD_UNSURE(placement=name))
    if not one_pose:
        notes.append(
            LIES_TURNED(
                placement=name, seconds=np.sum(over) / rate, begin_s=time[over][0],
                degrees=np.rad2deg(angle[over].max()),
            )
        )  # fmt: skip
    whole, rested, trunk, by_gravity = _motion(whole, axes, time, mask, rate, name, notes, one_pose)
    notes += rested.notes
    if abs(off := 1.0 / rested.scale - 1.0) > SCALE_NOTED:
        notes.append(SCALE_CORRECTED(placement=name, percent=100.0 * off, when="at rest"))
    contacts = _contacts(trunk, mask, rate, options)
    if by_gravity:
        contacts = contacts._replace(certainty=np.zeros_like(contacts.certainty))
    still = [(int(a), int(b)) for a, b in true_runs(rested.still)]
    nodes = waist_inputs.nodes(waist_inputs.bouts(contacts, still, rate, np.asarray(trunk.forward)), time)
    moves = np.stack([trunk.forward, trunk.upward], axis=1)[: len(time)]
    quality, more = waist_inputs.notes_of(nodes, len(contacts.time), name, time, moves)
    notes += more
    if left_out := waist_inputs.leave_out(nodes, ~mask, time):
        notes.append(STRIDES_MISSING(strides=left_out, placement=name, seconds=LONGEST_LOSS))
    standing = max(still, key=lambda run: run[1] - run[0], default=None)
    inputs = _assembled(whole, axes, time, mask, rate, rested, nodes)
    return Prepared(inputs, options, tuple(notes), standing, quality={name: quality})


def _checked(recording: Recording, name: str) -> np.ndarray:
    """The time of the samples, after checks of time, signals and sampling rate."""
    imu, rate = recording.sensors[name], recording.sampling_rate_hz
    low, high = shank_events.RATES
    if not low <= rate <= high:
        raise RecordingError(
            f"waist needs {low:g} to {high:g} Hz, for the jolts that tell a contact are faster than a slower "
            f"sensor can follow; the recording has {rate:g} Hz"
        )
    time = common_time(recording, [name], "waist", "the sensor", least_s=2.0)  # [s] four steps take longer
    check_nominal_rate(time, name, rate)
    median_force = float(np.median(np.linalg.norm(as_float(imu.acc)[np.asarray(imu.mask, bool)], axis=1)))
    if not 0.6 * GRAVITY < median_force < 1.6 * GRAVITY:  # outside, the unit is unknown
        raise RecordingError(
            f"'{name}' feels {median_force:.2f} m/s² on average, where a walking person feels about 9.81"
        )
    return time


def _motion(
    imu: Imu, axes: TrunkAxes, time: np.ndarray, mask: np.ndarray, rate: float, name: str, notes: list[Note],
    one_pose: bool,
) -> tuple[Imu, TrunkRest, TrunkMotion, bool]:  # fmt: skip
    """The sensor, its gyroscope's sign reversed if needed; its rest; the motion of the trunk, by the filter alone; and
    whether it is by the accelerometer alone.

    The sign is only judged if the sensor has one pose on the trunk. A gyroscope that contradicts the accelerometer is
    replaced: in a turn it would tip the trunk over, and no contact would be found behind the turn.
    """

    def moved(turned: Imu, rested: TrunkRest) -> tuple[TrunkMotion, float]:
        inputs = _assembled(turned, axes, time, mask, rate, rested, NO_NODES)
        # [s] of padding, so that its end does not affect the slowest filter
        inputs = pad(inputs, bucket(len(time) + round(10.0 * rate)))
        trunk = motion(WaistParams(), inputs, filtered=True)
        level = np.stack([trunk.forward, trunk.left], axis=1)[: len(time)]
        return trunk, float(np.mean(held_mean(level, window_size(1.0, rate)) ** 2))

    # The misfit is the mean square of the horizontal acceleration over a second: with the wrong sign the leans from
    # accelerometer and gyroscope have opposite signs. The logarithm of its growth is below −.5 in 14 public walks, and
    # within ±.2 in simulated people who hardly lean.
    candidates = []
    for sign in (1.0, -1.0):
        turned = imu._replace(gyr=sign * as_float(imu.gyr))
        rested = trunk_rest(turned, axes.rows, mask, rate)
        candidates.append((turned, rested, *moved(turned, rested)))
    growth = np.log(candidates[0][3] / candidates[1][3]) if candidates[1][3] > 0.0 else 0.0
    mirrored = one_pose and growth > 0.4
    turned, rested, trunk, _ = candidates[int(mirrored)]
    forces = np.stack([trunk.forward, trunk.left, trunk.upward + GRAVITY], axis=1)[: len(time)]
    apart = trunk_axes.tilted(forces, as_float(imu.acc) @ axes.rows.T, rate)
    # undamaged walks of `ipol_gait`, `mobgap_lab`, `neura_sparse` and `tripod` reach 8°
    if by_gravity := apart > np.deg2rad(15.0):
        text = (
            "{placement}: by its gyroscope it leans by up to {degrees:.0f}° away from what its accelerometer shows: "
            "the order or signs of axes of one of them are wrong, or a bias is large; the accelerometer is used alone"
        )
        notes.append(GYROSCOPE_CONTRADICTS.note(text, placement=name, degrees=np.rad2deg(apart)))
        turned, rested = trunk_axes.by_gravity(imu, rate), rested._replace(gyr_bias=np.zeros(3))
        trunk = moved(turned, rested)[0]
    elif mirrored:
        text = (
            "its gyroscope turns the other way than gravity: the axes are left-handed, or its sign is wrong; turned "
            "round, but left and right may be exchanged"
        )
        notes.append(GYROSCOPE_CONTRADICTS.note(text, placement=name))
    return turned, rested, trunk, bool(by_gravity)


def _turned_over(imu: Imu, up: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Angle of the sensor's mean force to the vertical of walking, in its axes (3,), for each sample [rad], and samples
    at which it is turned over or handled; none if they are few.
    """
    force = held_mean(as_float(imu.acc), window_size(1.0, rate))
    force = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
    angle = np.arccos(np.clip(force @ up, -1.0, 1.0))
    over, leans = angle > np.deg2rad(60.0), angle > np.deg2rad(25.0)  # sitting has less than 60°, public walks than 25°
    counts = leans.copy()
    for a, b in true_runs(~leans):
        leans[a:b] |= leans.any() and b - a < 3.0 * rate  # [s] upright for too short a time to walk
    for a, b in true_runs(leans):
        # the sensor is handled, or the person bends, if directions differ: a sensor that slipped keeps its direction
        there = force[a:b][counts[a:b]]
        over[a:b] |= np.sqrt(there.var(axis=0).sum()) > np.deg2rad(10.0)
    return angle, over & (np.sum(over) >= 2.0 * rate)


def _contacts(trunk: TrunkMotion, mask: np.ndarray, rate: float, options: WaistOptions) -> trunk_events.Contacts:
    """Contacts in order of time, on the host; contacts before the first or after the last sample are left out."""
    settings, samples = DETECTORS[options.detector], len(mask)
    measured = np.pad(mask, (0, trunk.forward.size - samples))
    contacts = trunk_events.initial_contacts(
        trunk.forward, trunk.upward, trunk.yaw_rate, float(rate), settings, mask=measured, leftward=trunk.left,
        roll_rate=trunk.roll_rate,
    )  # fmt: skip
    there = np.asarray(contacts.valid) & (contacts.time >= 0.0) & (contacts.time <= (samples - 1) / rate)
    rows = np.flatnonzero(there)
    rows = rows[np.argsort(contacts.time[rows], kind="stable")]
    return trunk_events.Contacts(*(field[rows] for field in contacts))


def _assembled(
    imu: Imu, axes: TrunkAxes, time: np.ndarray, mask: np.ndarray, rate: float, rested: TrunkRest,
    nodes: dict[str, np.ndarray],
) -> WaistInputs:  # fmt: skip
    """The inputs from signals and decisions, with the nodes' columns padded."""
    gyr, acc = (as_float(values) @ axes.rows.T for values in (imu.gyr, imu.acc))
    rows, count = NODES.length(len(time)), len(nodes["at"])
    columns = {}
    for name in PER_NODE:
        held, more = name in ("at", "contact") and count > 0, (0, rows - len(nodes[name]))
        columns[name] = np.pad(nodes[name], more, mode="edge") if held else np.pad(nodes[name], more)
    dt = np.diff(time, prepend=time[0])
    return WaistInputs(
        time=time, gyr=gyr, acc=acc * rested.scale, still=rested.still, measured=mask, valid=np.ones(len(time), bool),
        dt=dt, last=np.asarray(len(time) - 1, np.int32), rate_hz=np.asarray(float(rate)), gyr_bias=rested.gyr_bias,
        attitude=level(rested.first), start_variance=np.asarray(0.0 if rested.time > 0.0 else 1e-3),
        cycles=np.asarray(len(nodes["cycle_begin"]), np.int32), count=np.asarray(count, np.int32), **columns,
    )  # fmt: skip
