"""Whether a person walks: evidence of each sensor, and the probability of walking and of other movements over time.

A person who moves need not walk: people step in place, swing a leg, bend their knees, sit down, cycle or ride. In
walking a sensor on a leg gets ahead by nearly the length of its path, and its foot stands between two swings; the trunk
is accelerated up and forward with the steps, forward a quarter of a step before upward, and keeps its lean. All this is
computed in windows and without knowing the axes of a sensor.

Given a movement k of `KINDS`, the evidence φ of a sensor has the log odds a + Σ b φ over walking, with weights learned
for `movements.json`. Sensors add their log odds; a chain in which movements seldom change turns them into
probabilities.
"""

import json
from functools import cache
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from jgait.events.rest import JOLT, unrest
from jgait.geometry.rotation import integrated
from jgait.geometry.rotation import rows as matrix_rows
from jgait.geometry.vectors import GRAVITY, as_array
from jgait.signal.windows import held_mean, over_losses, window_maximum, window_size
from jgait.types import Imu, Recording, as_float

KINDS = {
    "walking": "walks", "in_place": "steps in place", "without_steps": "moves without steps or handles sensors",
    "cycling": "pedals, as on a bicycle", "riding": "is carried, as in a vehicle",
}  # fmt: skip
"""Movements, and how a note states them."""

STEP_S, GRID_S, WINDOW_S = 0.05, 0.25, 3.2
"""[s] Interval of the times of an `Activity`, interval at which evidence is computed, and window of the evidence: some
strides. Chosen by hand."""

LEVERS = {"foot": 0.05, "ankle": 0.1, "shank": 0.3}
"""[m] Usual height of a sensor over the point about which the segment turns while its foot stands."""

CALM_S = 0.1
"""[s] Window of the unrest of a sensor on a leg. It has a third part here, the difference of the specific force's size
from gravity."""

QUIET_S = 0.4
"""[s] A sensor is at rest if its unrest is small for so long; that of a trunk, which moves less, is over as long a
window."""

UPHELD = 0.5 * GRAVITY
"""[m/s²] Size of the mean force, in axes that do not turn, below which gyroscope and accelerometer contradict each
other, so that a window is no evidence."""

CARRIED_S = 1.0
"""[s] Time within which the mean force changes more than the turn explains, of a person at rest who is carried, as by a
treadmill's belt that starts."""

WALKS = 0.1
"""[1] Least probability with which a movement is taken for walking."""

EVIDENCE = {
    "leg": ("straight", "turn", "calm", "unrest", "path", "skew", "pull"),
    "trunk": ("surge", "quarter", "rhythm", "lean", "slow", "heave", "level", "spin"),
}
"""Segment → its evidence, in the order of the weights.

| leg | |
|---|---|
| `straight` | horizontal distance from first to last sample of the window over the length of the path |
| `turn` | change of heading, up to half a turn |
| `calm` | logarithm of the mean unrest at which the foot stands over the largest |
| `unrest`, `path` | logarithm of the largest unrest, and of the length of the path |
| `skew` | share of the third moment of the angular rate that is about one axis in one direction |
| `pull` | logarithm of the mean acceleration at which the foot stands over gravity |

| trunk | |
|---|---|
| `surge` | logarithm of the horizontal over the vertical acceleration in phase with it, at the step frequency |
| `quarter` | cosine of the difference of their phase from that of walking |
| `rhythm` | share of the step frequency and its double in the vertical acceleration |
| `lean` | logarithm of the largest change of the lean |
| `slow` | logarithm of the power below the step frequency over that of the vertical acceleration |
| `heave`, `level` | logarithm of the vertical acceleration, and of the power of the horizontal one over its power |
| `spin` | logarithm of the angular rate |
"""


class Activity(NamedTuple):
    """How a person moves."""

    time: np.ndarray  #: (N,) every `STEP_S` [s], on the sensors' clock.
    quiet: np.ndarray  #: (N,) bool, all sensors are at rest.
    carried: np.ndarray  #: (N,) bool, all are at rest, but what the person stands on gains or loses speed.
    probability: dict[str, np.ndarray]  #: kind of `KINDS` → (N,) its probability where the person moves [1].


@cache
def weights() -> dict[str, np.ndarray]:
    """Segment → (1 + evidence, kinds) intercepts and weights of the log odds over walking."""
    text = (files("jgait.events") / "movements.json").read_text(encoding="utf-8")
    return {name: np.asarray(rows, np.float64) for name, rows in json.loads(text)["weights"].items()}


def movement(recording: Recording) -> Activity | None:
    """How the person of a recording moves, while all sensors measure; None without a sensor on a shank, at an ankle, on
    a foot or on the trunk, or if a sensor cannot be read.
    """
    if not recording.sensors or not all(map(_readable, recording.sensors.values())):
        return None
    grids: list[tuple[np.ndarray, np.ndarray]] = []
    begin = max(float(imu.time[0]) for imu in recording.sensors.values())
    end = min(float(imu.time[-1]) for imu in recording.sensors.values())
    if end - begin < WINDOW_S:
        return None
    time = np.arange(begin, end + STEP_S, STEP_S)
    quiet, carried = np.ones(len(time), bool), np.ones(len(time), bool)
    for placement, imu in recording.sensors.items():
        segment = segment_of(placement)
        rate = (len(imu.time) - 1) / float(imu.time[-1] - imu.time[0])
        measured = np.asarray(imu.mask, bool)
        if not measured.any():
            continue
        gyr, acc = (over_losses(np.arange(len(measured)), values, measured) for values in (imu.gyr, imu.acc))
        imu = imu._replace(gyr=gyr, acc=acc)
        limit, wide = (0.12, QUIET_S) if segment == "trunk" else (0.35, CALM_S)
        restless = np.where(_lost(measured, QUIET_S, rate) > 0.5, np.inf, unrest(gyr, acc, window_size(wide, rate)))
        around = np.minimum(window_maximum(restless, window_size(QUIET_S, rate)), 1e3)
        quiet &= np.interp(time, as_float(imu.time), around) < limit
        if segment:
            carried &= np.interp(time, as_float(imu.time), _carried(imu, around < limit, rate)) > 0.5
            site = placement.partition("_")[0]
            at, evidence, known = of_leg(imu, rate, LEVERS[site]) if segment == "leg" else of_trunk(imu, rate)
            numbers = weights()[site if site in weights() else segment]
            rows = np.stack([evidence[name] for name in EVIDENCE[segment]], axis=1)
            odds = np.where(known[:, None], numbers[0] + rows @ numbers[1:], 0.0)
            lost = np.interp(at, as_float(imu.time) - imu.time[0], _lost(measured, WINDOW_S, rate))
            grids.append((at + float(imu.time[0]), np.where((lost > 0.1)[:, None], 0.0, odds)))
    if not grids:
        return None
    at = np.arange(begin, end, GRID_S)
    odds = np.sum([[np.interp(at, when, column) for column in rows.T] for when, rows in grids], axis=0).T
    chance = smoothed(0.15 * odds)  # windows share most of their samples with those beside them
    nearest = np.clip(np.rint((time - begin) / GRID_S).astype(int), 0, len(at) - 1)
    return Activity(
        time, quiet & ~carried, quiet & carried, {kind: chance[nearest, number] for number, kind in enumerate(KINDS)}
    )


def _lost(measured: np.ndarray, seconds: float, rate: float) -> np.ndarray:
    """(T,) share of lost samples in a window."""
    return held_mean((~measured).astype(np.float64), window_size(seconds, rate))


def _carried(imu: Imu, quiet: np.ndarray, rate: float) -> np.ndarray:
    """(T,) bool, near a change of the mean force at rest that the turn of the sensor does not explain."""
    gyr, lag = as_float(imu.gyr), round(CARRIED_S * rate)
    if quiet.sum() <= lag:
        return np.zeros(len(quiet), bool)
    force = held_mean(as_float(imu.acc), window_size(QUIET_S, rate))
    turned = np.cumsum(gyr - np.median(gyr[quiet], axis=0), axis=0) / rate
    change = force[lag:] - force[:-lag] + np.cross(turned[lag:] - turned[:-lag], force[lag:])
    calm = held_mean(quiet.astype(np.float64), 2 * (lag // 2) + 1) > 1.0 - 1e-9
    # [m/s²] standing sways less
    far = 1.0 * ((np.linalg.norm(change, axis=1) > 0.3) & calm[lag // 2 : lag // 2 + len(change)])
    return np.asarray(window_maximum(np.pad(far, (lag // 2, lag - lag // 2)), window_size(QUIET_S, rate)) > 0.5)


def _readable(imu: Imu) -> bool:
    """Whether a sensor has both signals, finite, at times that increase."""
    samples = len(imu.time)
    return (
        imu.acc is not None
        and samples > 1
        and np.shape(imu.gyr) == np.shape(imu.acc) == (samples, 3)
        and bool(np.isfinite(imu.gyr).all() and np.isfinite(imu.acc).all() and np.all(np.diff(imu.time) > 0.0))
    )


def segment_of(placement: str) -> str:
    """The kind of evidence of a sensor, a key of `EVIDENCE`; "" if it gives none."""
    if placement in ("lower_back", "pelvis", "waist"):
        return "trunk"
    return "leg" if placement.partition("_")[0] in LEVERS else ""


def smoothed(odds: np.ndarray, change: float = 0.08) -> np.ndarray:
    """(G, K) probabilities from log likelihoods (G, K), up to one common number a row, if a movement ends with the
    probability `change` within `GRID_S`.
    """
    count = odds.shape[1]
    likely = np.exp(odds - odds.max(axis=1, keepdims=True))
    both = []
    for way in (likely, likely[::-1]):
        belief, rows = np.full(count, 1.0 / count), []
        for row in way:
            rows.append(belief)
            belief = belief * row
            belief = (1.0 - change) * belief / belief.sum() + change / count
        both.append(np.array(rows))
    chance = both[0] * both[1][::-1] * likely
    return np.asarray(chance / chance.sum(axis=1, keepdims=True))


def attitudes(gyr: np.ndarray, acc: np.ndarray, rate: float) -> np.ndarray:
    """(T, 3, 3) rotations to the axes of the first sample."""
    return np.stack([as_array(row) for row in matrix_rows(integrated(gyr, acc, rate)[0])], axis=1)


type Evidence = tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]
"""Times (G,) [s], name → evidence (G,), and whether there is any (G,)."""


def of_leg(imu: Imu, rate: float, lever: float) -> Evidence:
    """Evidence of a sensor on a leg, `lever` [m] above its pivot. Its path is integrated between instants at which the
    foot stands: there its velocity is ω × lever up, and the mean specific force in between is gravity, up to the change
    of velocity.
    """
    gyr, acc = as_float(imu.gyr), as_float(imu.acc)
    samples, calm = len(gyr), window_size(CALM_S, rate)
    accelerated = held_mean(np.linalg.norm(acc, axis=1) - GRAVITY, calm)
    restless = np.hypot(unrest(gyr, acc, calm), accelerated / JOLT)
    # the foot stands where the unrest is the least within 0.25 s, and small beside the largest within 0.9 s
    near = window_size(0.5, rate)
    limit = np.maximum(0.24 * window_maximum(restless, window_size(1.8, rate)), 0.6)
    at = np.flatnonzero((restless <= -window_maximum(-restless, near)) & (restless < limit))
    at = at[np.diff(at, prepend=-near) > near // 2]
    turns = attitudes(gyr, acc, rate)
    force, spin = (np.einsum("tij,tj->ti", turns, values) for values in (acc, gyr))
    edges = np.unique(np.concatenate([[0], at, [samples - 1]]))
    quiet = held_mean(force, calm)
    up = quiet[edges] / np.linalg.norm(quiet[edges], axis=1, keepdims=True)
    start = np.cross(held_mean(spin, calm)[edges], lever * up)
    cycle = np.clip(np.searchsorted(edges, np.arange(samples), side="right") - 1, 0, len(edges) - 2)
    lasts = np.diff(edges)
    sums = np.cumsum(np.concatenate([np.zeros((1, 3)), force]), axis=0)
    mean = (sums[edges[1:]] - sums[edges[:-1]]) / lasts[:, None]
    vertical = (mean / np.linalg.norm(mean, axis=1, keepdims=True))[cycle]
    since = (np.arange(samples) - edges[:-1][cycle])[:, None]
    gained = (sums[:-1] - sums[edges[:-1]][cycle] - mean[cycle] * since) / rate
    step = (start[:-1][cycle] + gained + (start[1:] - start[:-1])[cycle] * since / lasts[cycle][:, None]) / rate
    along = np.sum(step * vertical, axis=1, keepdims=True)
    known = (lasts[cycle] < 3.0 * rate)[:, None]  # [s] after it no distance is known
    columns = [known * (step - along * vertical), np.linalg.norm(step, axis=1), np.sum(spin * vertical, axis=1) / rate]
    stood = np.zeros(samples)
    stood[at] = 1.0
    pull = np.linalg.norm(quiet - mean[cycle], axis=1) / GRAVITY
    cubes = np.sum(gyr**2, axis=1, keepdims=True) * gyr
    columns += [stood, stood * restless, stood * pull, np.linalg.norm(cubes, axis=1), cubes]
    total = np.cumsum(np.pad(np.column_stack(columns), ((1, 0), (0, 0))), axis=0)
    grid, half = np.arange(0, samples, max(1, round(GRID_S * rate))), round(0.5 * WINDOW_S * rate)
    end, begin = np.minimum(grid + half, samples), np.maximum(grid - half, 0)
    change = total[end] - total[begin]
    upheld = np.linalg.norm(sums[end] - sums[begin], axis=1) / (end - begin) > UPHELD
    net, path, turn, count, unrests, pulls, cubed = np.linalg.norm(change[:, :3], axis=1), *change[:, 3:9].T
    most = np.maximum(window_maximum(restless, 2 * half + 1)[grid], 1e-9)
    calmest = np.where(count > 0, unrests / np.maximum(count, 1.0), most) / most
    return grid / rate, {
        "straight": net / (path + 0.1), "turn": np.minimum(np.abs(turn) / np.pi, 1.0),
        "calm": np.log(np.clip(calmest, 3e-3, 1.0)), "unrest": np.log(most), "path": np.log(path + 0.1),
        "skew": np.linalg.norm(change[:, 9:], axis=1) / np.maximum(cubed, 1e-9),
        "pull": np.log(np.clip(pulls / np.maximum(count, 1.0), 0.03, 1.0)),
    }, (most > 0.4) & upheld  # fmt: skip


def of_trunk(imu: Imu, rate: float) -> Evidence:
    """Evidence of a sensor on the trunk, from its acceleration in axes that do not turn with it within a window."""
    every = max(1, round(rate / 50.0))
    count, hz = len(imu.time) // every, rate / every
    gyr, acc = (as_float(v)[: count * every].reshape(count, every, 3).mean(axis=1) for v in (imu.gyr, imu.acc))
    grid, half = np.arange(0, count, max(1, round(GRID_S * hz))), round(0.5 * WINDOW_S * hz)
    poses = attitudes(gyr, acc, hz)
    slow = held_mean(acc, window_size(0.8, hz))
    slow = slow / np.linalg.norm(slow, axis=1, keepdims=True)
    rows = np.clip(grid[:, None] + np.arange(-half, half + 1), 0, count - 1)
    taper = np.hanning(2 * half + 3)[1:-1]
    frequency = np.fft.rfftfreq(8 * len(taper), 1.0 / hz)
    columns: list[list[float]] = []
    for centre, window in zip(grid, rows, strict=True):
        force = (poses[window] @ acc[window][:, :, None])[:, :, 0] @ poses[centre]
        mean = force.mean(axis=0)
        up = mean / np.linalg.norm(mean)
        waves = np.fft.rfft((force - mean) * taper[:, None], 8 * len(taper), axis=0)
        upward = waves @ up
        power, every_power = np.abs(upward) ** 2, np.sum(np.abs(waves) ** 2, axis=1)
        step = frequency[np.argmax(np.where((frequency > 1.1) & (frequency < 4.0), power, 0.0))]
        band, twice = (np.abs(frequency - times * step) < 0.45 for times in (1.0, 2.0))
        wide, below = (frequency > 0.4) & (frequency < 8.0), (frequency > 0.15) & (frequency < 0.9)
        gain = waves[band].T @ upward[band].conj() / max(power[band].sum(), 1e-12)
        gain = gain - (gain @ up) * up
        axis = np.linalg.eigh(np.real(np.outer(gain, gain.conj())))[1][:, -1]
        surge = gain @ axis
        surge = -surge if surge.imag < 0.0 else surge
        whole, level = power[wide].sum() + 1e-12, (every_power - power)[wide].sum()
        lean = np.arccos(np.clip(slow[window] @ (slow[window].mean(axis=0)), -1.0, 1.0)).max()
        scale = 0.25 / len(taper) / np.sum(taper**2)
        # [rad] median phase of `ipol_gait`
        columns.append([
            abs(surge), np.cos(np.angle(surge) - np.deg2rad(103.0)), power[band | twice].sum() / whole, lean,
            every_power[below].sum() / whole, whole * scale, level / whole,
            np.sqrt(np.mean(np.sum(gyr[window] ** 2, axis=1))), (whole + level) * scale * (mean @ up > UPHELD),
        ])  # fmt: skip
    surge, quarter, rhythm, lean, slowly, heave, level, spin, power = np.array(columns).reshape(-1, 9).T
    # [m²/s⁴]
    return grid / hz, {
        "surge": np.log(np.clip(surge, 0.03, 0.8)), "quarter": quarter, "rhythm": rhythm,
        "lean": np.log(np.clip(lean, 0.1, 1.0)), "slow": np.log(np.clip(slowly, 0.2, 20.0)),
        "heave": 0.5 * np.log(np.clip(heave, 3e-3, 20.0)), "level": np.log(np.clip(level, 0.03, 1.2)),
        "spin": np.log(np.clip(spin, 0.03, 0.5)),
    }, power > 0.02  # fmt: skip
