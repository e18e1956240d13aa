"""From a recording to what the waist's estimator takes: axes, rest, contacts, bouts. On the host, in NumPy.

Everything here is a decision: which way the sensor looks, where the person stands, when which foot meets the ground.
Nothing here carries a gradient; what follows (`waist_ofdri.run`) is smooth given these decisions.
"""

from typing import Any, NamedTuple

import jax
import numpy as np

from jgait import rotation, shank_axes, shank_events, trunk_axes, trunk_events
from jgait.estimators import waist_motion
from jgait.estimators.checks import check_nominal_rate, common_time
from jgait.estimators.interface import bucket
from jgait.estimators.waist_inputs import PER_NODE, WaistInputs, capacity, pad
from jgait.estimators.waist_params import DETECTORS, SITES, WaistOptions, WaistParams, check_options
from jgait.kinematics import GRAVITY, Vector, vector
from jgait.rest import rest
from jgait.signal import true_runs, window_size
from jgait.trunk_axes import TrunkAxes
from jgait.types import Imu, Recording, RecordingError, as_float

STILL_WINDOW_S = 0.5
STILL_RATE, STILL_FORCE = 0.12, 0.25
"""[rad/s], [m/s²] Spread of rate and of the specific force's magnitude over the window, below which one stands."""

LEAST_REST_S = 2.0
"""[s] A gyroscope's bias is read only from so long a rest; a shorter one tells less than nothing."""

BIAS_KNOWN = 0.06
"""[rad/s] No gyroscope reads more than this at rest; what does, turns."""

PAUSE_STEPS, PAUSE_S = 2.2, 2.0
"""[steps], [s] Contacts further apart than both are of different bouts."""

START_S = 2.5
"""[s] A bout begins from standing if the person stood so long before its first contact, or less; likewise its end."""

LEAST_SECONDS = 2.0
"""[s] Four steps, fewer of which are no walking, take longer."""

UNITS_OF_G = (0.8, 1.25)
"""[m/s²] What an accelerometer reads on average whose readings are in g."""

LIKE_GRAVITY = (0.6, 1.6)
"""[1] Over gravity: what it may read on average; anything else is another unit."""


class Preparation(NamedTuple):
    """Inputs, and in words what was decided or noticed on the way."""

    inputs: WaistInputs
    notes: tuple[str, ...]
    standing: tuple[int, int] | None


def placement_of(recording: Recording, site: str = "auto") -> str:
    """The placement whose sensor is used.

    Raises:
        RecordingError: if the recording has none.
    """
    wanted = SITES[1:] if site == "auto" else (site,)
    for name in wanted:
        if name in recording.sensors:
            return name
    need = " or ".join(f"'{name}'" for name in wanted)
    raise RecordingError(f"waist_ofdri needs {need}; the recording has {sorted(recording.sensors)}")


def prepare(recording: Recording, options: WaistOptions) -> Preparation:
    """The inputs of `waist_ofdri.run` for a recording.

    Args:
        recording: a sensor at the waist, on the lower back or on the pelvis.
        options: see `WaistOptions`.

    Raises:
        RecordingError: no such sensor, no accelerometer, readings in units of g, NaN, too short, a clock that runs
            backwards, or a sampling rate that is not supported.
    """
    check_options(options)
    name = placement_of(recording, options.site)
    imu = recording.sensors[name]
    time = _checked(recording, name)
    rate = recording.sampling_rate_hz
    mask = np.asarray(imu.mask, bool) & (np.diff(time, prepend=time[0]) < 1.5 / rate)
    mask[0] = bool(np.asarray(imu.mask)[0])
    whole = shank_axes.filled(imu)
    notes: list[str] = []
    if not mask.all():
        notes.append(f"{int((~mask).sum())} samples of {name} are lost; the filter goes on without them")
    axes = trunk_axes.functional_axes(whole, rate)
    if axes is None:
        notes.append(f"{name} does not walk")
        up = as_float(whole.acc).mean(axis=0)
        axes = TrunkAxes(_any_axes(up / np.linalg.norm(up)), 0.0, 0.0)
        return Preparation(
            _assembled(whole, axes, time, mask, rate, _Rest.none(len(time)), _nodes([])), tuple(notes), None
        )
    notes.append(f"{name}: {trunk_axes.described(axes)}; corrected")
    if not axes.sure:
        notes.append(f"{name}: it is not sure which way is forward")
    rested = _rest(whole, axes, mask, rate)
    notes += rested.notes
    none = _nodes([])
    blank = _assembled(whole, axes, time, mask, rate, rested, none)
    contacts = _contacts(blank, options)
    still = [(int(a), int(b)) for a, b in true_runs(rested.still)]
    nodes = _nodes(_bouts(contacts, still, rate), rate, time)
    notes += _said(nodes, len(contacts.time))
    standing = max(still, key=lambda run: run[1] - run[0], default=None)
    return Preparation(_assembled(whole, axes, time, mask, rate, rested, nodes), tuple(notes), standing)


def _checked(recording: Recording, name: str) -> np.ndarray:
    """The time, signals and rate checked."""
    imu, rate = recording.sensors[name], recording.sampling_rate_hz
    low, high = shank_events.RATES
    if not low <= rate <= high:
        raise RecordingError(
            f"waist_ofdri needs {low:g} to {high:g} Hz, for the jolts that tell a contact are faster than a slower "
            f"sensor can follow; the recording has {rate:g} Hz"
        )
    if np.size(imu.time) < LEAST_SECONDS * rate:
        raise RecordingError(f"waist_ofdri needs {LEAST_SECONDS:g} s or more; '{name}' has {np.size(imu.time)} samples")
    time = common_time(recording, [name], "waist_ofdri", "the sensor")
    check_nominal_rate(time, name, rate)
    felt = float(np.median(np.linalg.norm(as_float(imu.acc)[np.asarray(imu.mask, bool)], axis=1)))
    if UNITS_OF_G[0] < felt < UNITS_OF_G[1]:
        raise RecordingError(
            f"'{name}' feels {felt:.2f} m/s² on average, gravity is 9.81: the accelerometer is in g, and needs m/s²"
        )
    if not LIKE_GRAVITY[0] * GRAVITY < felt < LIKE_GRAVITY[1] * GRAVITY:
        raise RecordingError(f"'{name}' feels {felt:.2f} m/s² on average, where a walking person feels about 9.81")
    return time


class _Rest(NamedTuple):
    """Where the person stands still, and what the sensor reads there."""

    still: np.ndarray
    gyr_bias: np.ndarray
    scale: float
    time: float
    first: np.ndarray
    notes: tuple[str, ...]

    @classmethod
    def none(cls, samples: int) -> "_Rest":
        return cls(np.zeros(samples, bool), np.zeros(3), 1.0, 0.0, np.array([0.0, 0.0, 1.0]), ())


def _rest(imu: Imu, axes: TrunkAxes, mask: np.ndarray, rate: float) -> _Rest:
    """Where the person stands still, what the gyroscope and the accelerometer read there; in the trunk's axes."""
    gyr, acc = (as_float(v) @ axes.rows.T for v in (imu.gyr, imu.acc))
    found = rest(gyr, acc, mask, rate)
    reads = found.gyr_bias if np.linalg.norm(found.gyr_bias) < BIAS_KNOWN else np.zeros(3)
    size = window_size(STILL_WINDOW_S, rate)
    still = _spread(gyr, size) < STILL_RATE
    still &= _spread(np.linalg.norm(acc, axis=1)[:, None], size) < STILL_FORCE
    # who leans or turns slowly does not stand
    still &= np.linalg.norm(_mean(gyr, size) - reads, axis=1) < STILL_RATE
    still &= mask
    notes: list[str] = []
    bias, seconds = _without_sway(gyr, acc, true_runs(still), rate)
    if seconds == 0.0:
        notes.append(
            f"nobody stands still for {LEAST_REST_S:g} s: the gyroscope is taken as it reads, and tilt is less certain"
        )
    runs = true_runs(still)
    scale = 1.0
    if runs:
        a, b = max(runs, key=lambda run: run[1] - run[0])
        felt = float(np.linalg.norm(acc[a:b].mean(axis=0))) / GRAVITY
        scale = 1.0 / felt
        if abs(felt - 1.0) > 0.01:
            notes.append(f"the accelerometer reads {100.0 * (felt - 1.0):+.1f} % of gravity at rest; corrected")
    early = next(((a, b) for a, b in runs if a < rate), None)
    first = acc[early[0] : early[1]].mean(axis=0) if early else np.array([0.0, 0.0, 1.0])
    return _Rest(still, bias, scale, seconds if early else 0.0, first / np.linalg.norm(first), tuple(notes))


def _without_sway(
    gyr: np.ndarray, acc: np.ndarray, runs: list[tuple[int, int]], rate: float
) -> tuple[np.ndarray, float]:
    """The gyroscope's bias (3,) [rad/s] and the time of rest that tells it [s].

    A rest's mean, less the turn that gravity shows from end to end; zero where nobody rests for long enough.
    """
    told, weights = [], []
    edge = max(1, int(0.25 * rate))
    for a, b in runs:
        if b - a < LEAST_REST_S * rate:
            continue
        before, after = (acc[c:d].mean(axis=0) for c, d in ((a, a + edge), (b - edge, b)))
        before, after = before / np.linalg.norm(before), after / np.linalg.norm(after)
        seconds = (b - a - edge) / rate
        # gravity's direction in the trunk's axes turns against the trunk
        told.append(gyr[a:b].mean(axis=0) + np.cross(before, after) / seconds)
        weights.append(seconds**2)
    if not told:
        return np.zeros(3), 0.0
    return np.average(told, axis=0, weights=weights), float(np.sqrt(np.sum(weights)))


def _mean(values: np.ndarray, size: int) -> np.ndarray:
    """(T, …) mean over a centred window, the ends held."""
    padded = np.pad(values, [(size // 2, size // 2), (0, 0)], mode="edge")
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(padded, axis=0)])
    return np.asarray((total[size:] - total[:-size]) / size)


def _spread(values: np.ndarray, size: int) -> np.ndarray:
    """(T,) standard deviation over a centred window, of all columns together."""
    centred = values - np.median(values, axis=0)
    return np.sqrt(np.maximum(_mean(centred**2, size) - _mean(centred, size) ** 2, 0.0).sum(axis=1))


_motion = jax.jit(waist_motion.motion, static_argnames=("smooth", "execution"))
_found = jax.jit(trunk_events.initial_contacts, static_argnums=3)
_found_by_paper = jax.jit(trunk_events.initial_contacts, static_argnums=(3, 4))


def _contacts(inputs: WaistInputs, options: WaistOptions) -> trunk_events.Contacts:
    """Contacts in order, on the host; those before the first sample or behind the last are left out."""
    samples, rate = inputs.time.size, float(inputs.rate_hz)
    padded = pad(inputs, bucket(samples, 1024))
    # the filter alone: smoothing moves contacts by a millisecond, and takes twice as long to compile
    seen = _motion(WaistParams(), padded, smooth=False, execution=options.execution)
    settings = DETECTORS[options.detector]
    call = _found_by_paper if isinstance(settings, trunk_events.PaperRule) else _found
    told = call(seen.forward, seen.upward, seen.yaw_rate, float(rate), settings, mask=padded.measured)
    told = trunk_events.Contacts(*(np.asarray(field) for field in told))
    there = np.asarray(told.valid) & (told.time >= 0.0) & (told.time <= (samples - 1) / rate)
    rows = np.flatnonzero(there)
    rows = rows[np.argsort(told.time[rows], kind="stable")]
    return trunk_events.Contacts(*(field[rows] for field in told))


class _Node(NamedTuple):
    """One node: its instant [samples, and parts of them], and what it is."""

    at: float
    contact: bool
    side: int
    moves: bool
    step: bool
    stands: bool
    fresh: bool


def _bouts(contacts: trunk_events.Contacts, still: list[tuple[int, int]], rate: float) -> list[list[_Node]]:
    """Contacts parted into bouts, with the standing before and behind each as nodes of their own."""
    at, side = as_float(contacts.time) * rate, np.asarray(contacts.side)
    if not len(at):
        return []
    pause = np.maximum(PAUSE_STEPS / np.maximum(as_float(contacts.step_frequency), 0.5), PAUSE_S) * rate
    cut = np.flatnonzero(np.diff(at) > pause[1:]) + 1
    bouts: list[list[_Node]] = []
    stood = -1.0
    for rows in np.split(np.arange(len(at)), cut):
        first, last = at[rows[0]], at[rows[-1]]
        before = max((b - 1.0 for a, b in still if b - 1.0 < first), default=-1.0)
        behind = min((float(a) for a, b in still if a > last), default=np.inf)
        nodes: list[_Node] = []
        from_rest = before >= stood and before >= 0.0 and first - before <= START_S * rate
        if from_rest:
            nodes.append(_Node(before, False, 0, False, False, True, True))
        for number, row in enumerate(rows):
            fresh = number == 0 and not from_rest
            nodes.append(_Node(at[row], True, int(side[row]), not fresh, number > 0, False, fresh))
        if behind - last <= START_S * rate:
            nodes.append(_Node(behind, False, 0, True, False, True, False))
            stood = behind
        else:
            stood = last
        bouts.append(nodes)
    return bouts


def _nodes(bouts: list[list[_Node]], rate: float = 1.0, time: Any = (0.0,)) -> dict[str, np.ndarray]:
    """The bouts as columns, each of as many rows as there are nodes."""
    flat = [node for bout in bouts for node in bout]
    stood = np.array([bout[0].stands for bout in bouts for _ in bout], bool)
    alone = np.array([sum(node.step for node in bout) for bout in bouts for _ in bout], float)
    instant = np.array([node.at for node in flat], float)
    at = np.rint(instant).astype(np.int32)
    # two nodes on one sample: the later one is moved on
    for row in range(1, len(at)):
        at[row] = max(at[row], at[row - 1] + 1)
    at = np.minimum(at, len(time) - 1)
    columns = {
        name: np.array([getattr(node, name[:-1] if name in ("contacts", "steps") else name) for node in flat], kind)
        for name, kind in (("side", np.int32), ("contacts", bool), ("steps", bool), ("moves", bool), ("stands", bool),
                           ("fresh", bool))
    }  # fmt: skip
    steps, side, contacts = columns["steps"], columns["side"], columns["contacts"]
    stride = np.zeros(len(flat), bool)
    stride[2:] = steps[2:] & steps[1:-1] & (side[2:] == side[:-2]) & (side[1:-1] != side[2:]) & contacts[:-2]
    index = np.arange(len(time), dtype=float)
    contact = np.interp(instant, index, as_float(time)) if len(flat) else np.zeros(0)
    foot = side[np.flatnonzero(stride)[0]] if stride.any() else 0
    ends = np.flatnonzero(stride & (side == foot))
    return {
        **columns, "at": at, "contact": contact, "stride": stride, "stood": stood, "alone": alone,
        "cycle_begin": at[ends - 2], "cycle_end": at[ends],
    }  # fmt: skip


def _said(nodes: dict[str, np.ndarray], contacts: int) -> list[str]:
    """What is to be said of the bouts."""
    if not contacts:
        return ["nobody walks: no initial contact was found"]
    fresh = np.flatnonzero(nodes["fresh"])
    notes = []
    for number, row in enumerate(fresh, start=1):
        if not nodes["stands"][row]:
            when = nodes["contact"][row]
            notes.append(
                f"bout {number} of {len(fresh)}, from {when:.1f} s, does not begin from standing: what integration "
                f"says of its speed is not to be relied on"
            )
    return notes


def _level(up: np.ndarray) -> np.ndarray:
    """(4,) the shortest rotation q_ws that takes a direction in the trunk's axes to the world's z."""
    return np.asarray(rotation.as_array(rotation.between(vector(up), Vector(*np.eye(3)[2]))))


def _any_axes(up: np.ndarray) -> np.ndarray:
    """(3, 3) rows forward, left, up with forward anywhere."""
    forward = np.cross(np.eye(3)[int(np.argmin(np.abs(up)))], up)
    forward = forward / np.linalg.norm(forward)
    return np.stack([forward, np.cross(up, forward), up])


def _assembled(
    imu: Imu, axes: TrunkAxes, time: np.ndarray, mask: np.ndarray, rate: float, rested: _Rest,
    nodes: dict[str, np.ndarray],
) -> WaistInputs:  # fmt: skip
    """Signals and decisions, with rows for as many nodes as there is room for."""
    gyr, acc = (as_float(values) @ axes.rows.T for values in (imu.gyr, imu.acc))
    rows, count = capacity(len(time)), len(nodes["at"])

    def filled(name: str, values: np.ndarray) -> np.ndarray:
        more = rows - len(values)
        held = name in ("at", "contact") and len(values) > 0
        return np.pad(values, (0, more), mode="edge") if held else np.pad(values, (0, more))

    dt = np.diff(time, prepend=time[0])
    return WaistInputs(
        time=time, gyr=gyr, acc=acc * rested.scale, still=rested.still, measured=mask, valid=np.ones(len(time), bool),
        dt=dt, last=np.asarray(len(time) - 1, np.int32), rate_hz=np.asarray(float(rate)), gyr_bias=rested.gyr_bias,
        attitude=_level(rested.first), start_variance=np.asarray(0.0 if rested.time > 0.0 else 1e-3),
        cycles=np.asarray(len(nodes["cycle_begin"]), np.int32), count=np.asarray(count, np.int32),
        **{name: filled(name, nodes[name]) for name in PER_NODE},
    )  # fmt: skip
