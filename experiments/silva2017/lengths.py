"""Stride lengths of legs by every method, from one compiled program a set, and parameters learned on other legs."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.shanks import Leg
from experiments.silva2017 import literal
from experiments.silva2017.detect import padded, pairs, strides_of
from experiments.silva2017.li import planar
from jgait.estimators.ankle_stride import length as stride_length
from jgait.estimators.ankle_stride.length import StrideLengthParams
from jgait.events import shank_stance
from jgait.geometry.vectors import Vector
from jgait.mounting import shank as shank_axes
from jgait.signal import butterworth, marks

CUTOFF_HZ = 4.0  # the paper's
_smooth = jax.jit(butterworth.low_pass_both_ways, static_argnums=2)


class Signals(NamedTuple):
    """A leg as the methods take it; legs of a set are padded to one length and stack.

    Attributes:
        gyr, acc: (T, 3) in the segment's axes.
        straight_gyr, straight_acc: (T, 3) in the sensor's own axes nearest to them, for Li's method.
        stride: flags of strides.
        end: (n,) samples at which strides end; swing_begin, swing_end: at which swings begin and end.
        length: (n,) by the reference [m]; 0 where the reference has no length.
        known: (n,) bool, whether there is one; full: a whole stride.
        dt: [s].
    """

    gyr: Any
    acc: Any
    straight_gyr: Any
    straight_acc: Any
    stride: marks.Marks
    end: Any
    swing_begin: Any
    swing_end: Any
    length: Any
    known: Any
    full: Any
    dt: Any


def _events(leg: Leg) -> tuple[np.ndarray, np.ndarray, shank_stance.ShankStances, np.ndarray, np.ndarray]:
    """Swings [samples] and stances around them, and signals in the segment's axes, up as in stance."""
    gyr = np.asarray(_smooth(padded(np.asarray(leg.imu.gyr)), shank_stance.CUTOFF_HZ, leg.rate_hz))
    acc = np.asarray(_smooth(padded(np.asarray(leg.imu.acc)), shank_stance.CUTOFF_HZ, leg.rate_hz))
    told = strides_of(leg)
    start, end = (np.rint(np.asarray(v) * leg.rate_hz).astype(int) for v in (told.start, told.end))
    count, rate, speed = len(leg.imu.time), gyr @ leg.axes.rows[1], np.linalg.norm(gyr, axis=1)
    stood = shank_stance.stances(rate[:count], speed[:count], start, end, leg.rate_hz)
    return start, end, stood, acc, np.asarray(leg.imu.mask)


def reference_lengths(leg: Leg, end: np.ndarray, stood: shank_stance.ShankStances) -> tuple[np.ndarray, np.ndarray]:
    """Length of each of our strides by the reference, NaN where there is none, and whether it is a whole one."""
    reference = leg.reference
    length, full = np.full(len(end), np.nan), np.zeros(len(end), bool)
    for i, j in pairs(end / leg.rate_hz, reference.contact):
        length[i], full[i] = reference.length[j], reference.full[j]
    if reference.positions is not None:
        there = np.isfinite(length)
        apart = reference.positions[stood.end] - reference.positions[stood.begin]
        length = np.where(there, np.linalg.norm(apart, axis=1), np.nan)
    return length, full


def nearest_axes(axes: shank_axes.Axes) -> np.ndarray:
    """(3, 3) the sensor axes nearest to forward, left and up: a mounting assumed to be straight, as in the paper."""
    rows = axes.rows
    left = np.zeros(3)
    left[np.argmax(np.abs(rows[1]))] = 1.0
    left = left * np.sign(rows[1] @ left)
    above = np.where(left != 0.0, 0.0, rows[2])
    up = np.zeros(3)
    up[np.argmax(np.abs(above))] = 1.0
    up = up * np.sign(rows[2] @ up)
    return np.stack([np.cross(left, up), left, up])


def signals(leg: Leg, turn: np.ndarray | None = None) -> Signals:
    """A leg ready for the methods; `turn` (3, 3) turns the sensor on the leg, unknown to the method."""
    nearest = nearest_axes(leg.axes)
    if turn is not None:
        imu = leg.imu._replace(gyr=np.asarray(leg.imu.gyr) @ turn.T, acc=np.asarray(leg.imu.acc) @ turn.T)
        axes = shank_axes.functional_axes(imu)
        if axes is None:
            raise ValueError(f"{leg.walk}, {leg.side}: the turned sensor does not walk")
        leg = leg._replace(imu=imu, axes=axes)
    start, end, stood, acc, _ = _events(leg)
    rows = shank_axes.stance_up(leg.axes, acc, stood.end[~stood.standing[:, 1]]).rows
    length, full = reference_lengths(leg, end, stood)
    raw = [padded(np.asarray(v)) for v in (leg.imu.gyr, leg.imu.acc)]
    total = len(raw[0])
    known = np.isfinite(length)
    return Signals(
        raw[0] @ rows.T, raw[1] @ rows.T, raw[0] @ nearest.T, raw[1] @ nearest.T,
        jax.tree.map(np.asarray, marks.marks(stood.begin, stood.end, total)),
        stood.end, start, end, np.where(known, length, 0.0), known, full & known, np.asarray(1.0 / leg.rate_hz),
    )  # fmt: skip


def stacked(items: list[Signals], room: int = 1) -> Signals:
    """Legs of one set, padded to one length and one number of strides, for which there is at least so much room."""
    samples, strides = max(len(s.gyr) for s in items), max(room, *(len(s.end) for s in items))

    def longer(values: np.ndarray, count: int) -> np.ndarray:
        return np.pad(values, [(0, count - len(values))] + [(0, 0)] * (values.ndim - 1))

    def one(s: Signals) -> Signals:
        made = {}
        for name, value in s._asdict().items():
            if name == "dt":
                made[name] = value
            else:
                count = strides if name in ("end", "swing_begin", "swing_end", "length", "known", "full") else samples
                made[name] = jax.tree.map(lambda v, count=count: longer(np.asarray(v), count), value)
        return Signals(**made)

    return jax.tree.map(lambda *v: jnp.asarray(np.stack(v)), *map(one, items))


def smoothed(signal: Any, cutoff_hz: Any, rate_hz: Any) -> Any:
    """Low-pass of a (T, 3) signal without delay; None: no filter."""
    return signal if cutoff_hz is None else jnp.asarray(butterworth.low_pass_both_ways(signal, cutoff_hz, rate_hz))


def _one(method: str, p: StrideLengthParams, cutoff: Any, s: Signals) -> Any:
    """(n,) lengths of a leg's strides."""
    if method in ("SL1", "SL2", "SL2 of all axes"):
        gyr = literal.all_axes(s.gyr) if method == "SL2 of all axes" else s.gyr
        swung = stride_length.pendulum(p, gyr, s.swing_begin, s.swing_end, s.dt)
        return swung.chord if method == "SL1" else swung.arc
    if method == "swing":
        swung = stride_length.pendulum(p, s.gyr, s.swing_begin, s.swing_end, s.dt)
        return jnp.stack([swung.angle, swung.duration], axis=-1)
    rate_hz = 1.0 / s.dt
    if method.startswith("Li 2-D"):
        taken = (s.gyr, s.acc) if method == "Li 2-D, axes from the walk" else (s.straight_gyr, s.straight_acc)
        gyr, acc = (smoothed(v, cutoff, rate_hz) for v in taken)
        return planar(p, gyr, acc, s.stride, s.dt).length[s.end]
    gyr, acc = (smoothed(v, cutoff, rate_hz) for v in (s.gyr, s.acc))
    inertial = literal.inertial if method == "3-D as printed" else stride_length.inertial
    told = inertial(p, gyr, acc, s.stride, s.dt)
    return {"3-D level": told.level, "rise": told.rise, "turn": told.turn}.get(method, told.length)[s.end]


lengths = jax.jit(jax.vmap(_one, in_axes=(None, None, None, 0)), static_argnums=0)
"""(method, parameters, cut-off [Hz], stacked signals) → (legs, n)."""


class Errors(NamedTuple):
    """Of the lengths of whole strides and half-steps alike, where the reference has a length.

    Attributes:
        each: error of every stride [m].
        total: (legs,) of the sum of a leg's strides, relative [1].
    """

    each: np.ndarray
    total: np.ndarray

    @property
    def mae_cm(self) -> float:
        """Mean absolute error of a stride [cm]."""
        return 100.0 * float(np.mean(np.abs(self.each)))

    @property
    def total_pct(self) -> float:
        """Mean absolute error of a leg's total [%]."""
        return 100.0 * float(np.mean(np.abs(self.total)))


def errors(ours: Any, s: Signals, *, full: bool = True) -> Errors:
    """Errors of lengths (legs, n) against the reference."""
    looked = np.asarray(s.full if full else s.known)
    theirs, mine = np.asarray(s.length), np.asarray(ours)
    total = [a[m].sum() / b[m].sum() - 1.0 for a, b, m in zip(mine, theirs, looked, strict=True) if m.any()]
    return Errors((mine - theirs)[looked], np.array(total))


def with_lever(height: Any) -> StrideLengthParams:
    """Parameters with a sensor this far above the point that stands [m]."""
    return StrideLengthParams(lever=Vector(0.0, 0.0, height))


class Learned(NamedTuple):
    """What was learned on some legs: height of the sensor over the ankle [m], and cut-off of the filter [Hz]."""

    height: float
    cutoff_hz: float


EXPECTED = Learned(0.1, 5.0)  # before any data; 0.1 m either way, and a factor of 1.5
SPREAD = (0.1, float(np.log(1.5)))
STRIDE_SD = 0.03  # [m] of a stride's length against a reference
SETTLED = 1e-5  # [m], and of the logarithm [1]: a smaller step is the last


def _moved(free: Any, s: Signals, method: str) -> tuple[Any, Any]:
    """Errors of all strides (legs, n) at free values (height, log of the cut-off), and their derivatives (2, …)."""

    def off(values: Any) -> Any:
        return lengths(method, with_lever(values[0]), jnp.exp(values[1]), s) - s.length

    error, push = jax.linearize(off, free)
    return error, jax.vmap(push)(jnp.eye(2))


_moved_jit = jax.jit(_moved, static_argnums=2)


def learn(s: Signals, chosen: np.ndarray | None = None, method: str = "3-D", *, cutoff: bool = False) -> Learned:
    """Height of the sensor, and cut-off, that make whole strides least wrong, by gradient.

    Gauss and Newton on √(e² + (2 cm)²), so that a wrong reference does not decide, with what was expected before as a
    further measurement.

    Args:
        s: stacked legs.
        chosen: (legs,) bool, those to learn on; None: all.
        method: whose lengths.
        cutoff: learn it too; otherwise it is the paper's.
    """
    prior = np.array([EXPECTED.height, np.log(EXPECTED.cutoff_hz if cutoff else CUTOFF_HZ)])
    free = prior.copy()
    looked = np.asarray(s.full) & (True if chosen is None else np.asarray(chosen)[:, None])
    for _ in range(6):
        error, slope = (np.asarray(v) for v in _moved_jit(jnp.asarray(free), s, method))
        e, d = error[looked], slope[:, looked] * np.array([[1.0], [float(cutoff)]])
        weight = STRIDE_SD**-2 * np.sqrt(0.02**2 / (e**2 + 0.02**2))
        normal = (d * weight) @ d.T + np.diag(1.0 / np.square(SPREAD))
        pull = (d * weight) @ e + (free - prior) / np.square(SPREAD)
        step = np.linalg.solve(normal, pull)
        free = free - np.clip(step, -np.array(SPREAD), np.array(SPREAD))
        if np.max(np.abs(step)) < SETTLED:
            break
    return Learned(float(free[0]), float(np.exp(free[1])))


def part(s: Signals, chosen: np.ndarray) -> Signals:
    """Some of the legs."""
    return jax.tree.map(lambda v: v[np.asarray(chosen)], s)
