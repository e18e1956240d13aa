r"""Orientation of a sensor on the trunk, computed from walking; on the host, not under jit.

Gravity gives the vertical. The trunk in walking is accelerated up and forward once per step, the forward acceleration a
quarter of a step before the upward one; sideways it swings once per stride. With U and H the complex amplitudes of the
upward and the two horizontal accelerations at the step frequency, the forward axis is the unit vector n for which

    c = Σ H U* / Σ |U|²,        |c · n| is greatest,        Im (c · n) > 0.

In running the forward acceleration follows the upward one instead. Walking decides; if the person only runs, Im (c · n)
< 0. In a bout of few steps, setting off and stopping hide this phase; between two rests, forward is where the person
went.

On the walks of `ipol_gait` and the straight walks of `mobgap_lab` the computed axis is within 15° of the mounted
sensor's forward axis, and the phase of c · n between 75° and 125° (tested).
"""

import itertools
from typing import NamedTuple

import numpy as np

from jgait.geometry.vectors import GRAVITY
from jgait.signal.windows import held_mean, true_runs, window_size, window_sum
from jgait.types import Imu, RecordingError, as_float

LEAST_WALKING_ACC = 0.25
"""[m/s²] Least root mean square acceleration of walking at the step frequency. Chosen by hand."""

FREE, OVER_S = 0.35, 0.05
"""[1] Mean specific force over gravity, in a window of `OVER_S` [s], below which the trunk is in free fall. In running
it is near 0 once in each step; walks of `ipol_gait` and `mobgap_lab` stay far above it."""

GRAVITY_S = 1.5
"""[s] Window of the mean that leaves gravity of the force, longer than a stride; `by_gravity` applies it twice. Chosen
by hand."""


class TrunkAxes(NamedTuple):
    """Orientation of a sensor on the trunk."""

    rows: np.ndarray  #: (3, 3) forward, left and up in the sensor's axes [1]; `gyr @ rows.T` is in the trunk's axes.
    step_frequency: float  #: step frequency of the whole recording [Hz].
    #: phase lead of the forward over the upward acceleration at that frequency [rad]; walking has about π/2.
    phase: float
    went: bool = False  #: forward is where the person went, see `where_one_went`.

    @property
    def sure(self) -> bool:
        """Whether forward and backward are distinguished with certainty: on 36 walks of `ipol_gait` and 4 of
        `mobgap_lab` the phase differs from a quarter of a step by up to 33°.
        """
        return self.went or bool(abs(self.phase - 0.5 * np.pi) < np.deg2rad(40.0))


def functional_axes(imu: Imu, sampling_rate_hz: float, worn: np.ndarray | None = None) -> TrunkAxes | None:
    """Forward, left and up in a sensor's axes, from its accelerations in walking; None if nobody walks. Lost samples
    are filled, see `mounting.shank.filled`; `worn` (T,) bool is False where the sensor is not on the trunk.

    Raises:
        RecordingError: if there is no accelerometer.
    """
    if imu.acc is None:
        raise RecordingError("the axes of a trunk need an accelerometer; the sensor has a gyroscope only")
    acc = as_float(imu.acc)
    # only the walking part: in sitting or lying the trunk leans differently
    walking = _walking(acc, sampling_rate_hz) & (worn is None or worn)
    if not walking.any():
        return None
    # running: less than half a second from a sample at which the trunk is in free fall
    force_g = held_mean(np.linalg.norm(acc, axis=1), window_size(OVER_S, sampling_rate_hz)) / GRAVITY
    runs = walking & (window_sum((force_g < FREE).astype(float), window_size(1.0, sampling_rate_hz)) > 0.5)
    only_runs = np.sum(walking & ~runs) < min(5.0 * sampling_rate_hz, runs.sum())  # [s] of walking
    walking = runs if only_runs else walking & ~runs
    up, amplitude, frequency, steps = _spectrum(acc, walking, sampling_rate_hz)
    size = 2 * (len(amplitude) - 1)
    band = (frequency > 0.75 * steps) & (frequency < 1.3 * steps)
    upward = amplitude[band] @ up
    if np.sqrt(2.0 * np.sum(np.abs(upward) ** 2) / size / walking.sum()) < LEAST_WALKING_ACC:
        return None
    side = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    side = side / np.linalg.norm(side)
    two = np.cross(up, side)
    level = amplitude[band] @ np.stack([side, two], axis=1)
    gain = np.sum(level * upward.conj()[:, None], axis=0) / np.sum(np.abs(upward) ** 2)
    axis = np.linalg.eigh(np.real(np.outer(gain, gain.conj())))[1][:, -1]
    along = gain.conj() @ axis if only_runs else gain @ axis
    if along.imag < 0.0:
        axis, along = -axis, -along
    forward = axis[0] * side + axis[1] * two
    return TrunkAxes(np.stack([forward, np.cross(up, forward), up]), steps, float(np.angle(along)))


def moved_between(acc: np.ndarray, still: np.ndarray, sampling_rate_hz: float) -> np.ndarray:
    """Displacement (T, n) since the rest before [m], by integrating accelerations (T, n) [m/s²] from rest to rest; 0 at
    rest and where there is no rest within 30 s. `still` (T,) bool is True where the person stands.
    """
    moved = np.zeros_like(acc)
    for (_, begin), (end, _) in itertools.pairwise(true_runs(still)):
        if end - begin < 30.0 * sampling_rate_hz:
            speed = np.cumsum(acc[begin:end], axis=0) / sampling_rate_hz
            speed -= np.linspace(0.0, 1.0, end - begin)[:, None] * speed[-1]
            moved[begin:end] = np.cumsum(speed, axis=0) / sampling_rate_hz
    return moved


def where_one_went(axes: TrunkAxes, level: np.ndarray, still: np.ndarray, sampling_rate_hz: float) -> TrunkAxes:
    """The axes, with the forward axis along the person's displacement between two rests, by integrated accelerations,
    unless no displacement exceeds 1 m. `level` (T, 2) is the acceleration forward and to the left [m/s²];
    `still` (T,) is True where the person stands.
    """
    stops = np.flatnonzero(~still[:-1] & still[1:])
    way = moved_between(level, still, sampling_rate_hz)[stops].sum(axis=0)
    if np.hypot(*way) < 1.0:
        return axes
    forward, left, up = axes.rows
    forward = (way[0] * forward + way[1] * left) / np.hypot(*way)
    return axes._replace(rows=np.stack([forward, np.cross(up, forward), up]), went=True)


def centred(imu: Imu, rows: np.ndarray, sampling_rate_hz: float) -> Imu:
    """The sensor, moved to the middle of the trunk if turns of the trunk show that it is worn at a side.

    A point y to the left of the middle is accelerated further by −y ω̇_u forward and by y ω̇_f upward. These parts
    reverse from step to step, those of the middle repeat, so that least squares over the walk give y. `rows` (3, 3) are
    the trunk's axes.
    """
    gyr, acc = (as_float(values) @ rows.T for values in (imu.gyr, imu.acc))
    turns = np.gradient(held_mean(gyr, window_size(0.05, sampling_rate_hz)), axis=0) * sampling_rate_hz
    for_one_metre, ahead_and_up = np.stack([-turns[:, 2], turns[:, 0]], axis=1), acc[:, [0, 2]]
    blunt, slow = (window_size(seconds, sampling_rate_hz) for seconds in (0.1, 1.0))  # faster, slower than steps
    walks = _walking(acc, sampling_rate_hz)
    part, whole = (
        (held_mean(values, blunt) - held_mean(values, slow))[walks] for values in (for_one_metre, ahead_and_up)
    )
    both, alone = np.sum(part * whole), max(float(np.sum(part * part)), 1e-12)
    if both**2 < 0.1 * alone * np.sum(whole * whole):
        return imu
    acc[:, [0, 2]] -= both / alone * for_one_metre
    return imu._replace(acc=acc @ rows)


def step_frequency(acc: np.ndarray, sampling_rate_hz: float) -> float:
    """[Hz] Step frequency of the specific force (T, 3) where the trunk walks; 0 if it never does."""
    walking = _walking(acc, sampling_rate_hz)
    return _spectrum(acc, walking, sampling_rate_hz)[-1] if walking.any() else 0.0


def tilted(forces: np.ndarray, acc: np.ndarray, sampling_rate_hz: float) -> float:
    """Largest angle [rad] of the mean force over 4 s from the vertical, of forces (T, 3) in the world, z up: small if
    the attitude is right. Only windows count in and beside which `acc` (T, 3), in the trunk's axes, is within 25° of
    upright, as a sensor held in a hand is not; 0 without such a window.
    """
    size = window_size(4.0, sampling_rate_hz)  # [s] nobody accelerates for so long
    if len(forces) < size:
        return 0.0
    leans = _from_vertical(held_mean(acc, window_size(GRAVITY_S, sampling_rate_hz))) > np.deg2rad(25.0)
    counts = window_sum(leans.astype(float), 2 * size - 1) < 0.5
    angles = np.where(counts, _from_vertical(held_mean(forces, size)), 0.0)
    return float(angles[size // 2 : len(angles) - size // 2].max())


def _from_vertical(vectors: np.ndarray) -> np.ndarray:
    return np.arctan2(np.hypot(vectors[:, 0], vectors[:, 1]), vectors[:, 2])


def by_gravity(imu: Imu, sampling_rate_hz: float) -> Imu:
    """The sensor with the angular rate that its accelerometer shows, for a gyroscope whose axes or signs are wrong: the
    slow turn of gravity, and about the vertical the slow rate of the gyroscope about its axis of most rotation, whose
    size is right and whose sign may be wrong.
    """
    size = window_size(GRAVITY_S, sampling_rate_hz)
    up, rate = (held_mean(held_mean(as_float(values), size), size) for values in (imu.acc, imu.gyr))
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    axis = np.linalg.eigh(rate.T @ rate)[1][:, -1]
    axis = axis if axis @ up.mean(axis=0) > 0.0 else -axis
    tilting = np.cross(np.gradient(up, axis=0) * sampling_rate_hz, up)
    return imu._replace(gyr=tilting + (rate @ axis)[:, None] * up)


def _spectrum(
    acc: np.ndarray, walking: np.ndarray, sampling_rate_hz: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """The vertical (3,) in walking (T,), complex amplitudes of the force (T, 3) in walking and their frequencies, and
    the step frequency [Hz].

    That is the frequency of most power of all axes, smoothed over a tenth of a hertz, or that of the vertical one if it
    is about twice as large: that of all axes is then of the sway.
    """
    mean = acc[walking].mean(axis=0)
    up, size = mean / np.linalg.norm(mean), 1 << int(np.ceil(np.log2(2 * len(acc))))
    amplitude = np.fft.rfft(np.where(walking[:, None], acc - mean, 0.0), size, axis=0)
    frequency = np.arange(len(amplitude)) * sampling_rate_hz / size
    width = max(1, int(np.sum(frequency < 0.1)))

    def greatest(power: np.ndarray, fastest: float) -> float:
        smooth = np.convolve(power, np.ones(width) / width, mode="same")
        inside = np.flatnonzero((frequency >= 1.2) & (frequency <= fastest))
        return float(frequency[inside[int(np.argmax(smooth[inside]))]])

    of_all = greatest(np.sum(np.abs(amplitude) ** 2, axis=1), 2.8)
    upward = greatest(np.abs(amplitude @ up) ** 2, 3.5)  # for children who walk quickly
    return up, amplitude, frequency, upward if upward > 1.75 * of_all else of_all


def _walking(acc: np.ndarray, sampling_rate_hz: float) -> np.ndarray:
    """(T,) bool: where the magnitude of the specific force has a standard deviation over two seconds above
    `LEAST_WALKING_ACC`.
    """
    size = np.linalg.norm(acc, axis=1)
    window = max(3, int(2.0 * sampling_rate_hz))
    if len(size) <= window:
        window = max(3, len(size) // 2)
    kernel = np.ones(window) / window
    mean = np.convolve(size, kernel, mode="same")
    weight = np.convolve(np.ones_like(size), kernel, mode="same")
    spread = np.convolve((size - mean / weight) ** 2, kernel, mode="same") / weight
    return np.asarray(spread > LEAST_WALKING_ACC**2)


def worn(axes: TrunkAxes) -> dict[str, str | float]:
    """How the sensor is worn: the sensor axes that point up and forward, such as "z" or "−x", and two angles [°]:
    `lean_deg` of `up` from the vertical, `turned_deg` of `forward` from the direction of walking, in the horizontal
    plane.
    """
    names, nearest = [], np.zeros((3, 3))
    for number in (2, 0):
        row = np.where(np.abs(nearest).sum(axis=0) > 0.0, 0.0, axes.rows[number])
        best = int(np.argmax(np.abs(row)))
        nearest[number, best] = np.sign(row[best])
    nearest[1] = np.cross(nearest[2], nearest[0])
    for number in (2, 0):
        best = int(np.argmax(np.abs(nearest[number])))
        names.append(("−" if nearest[number, best] < 0.0 else "") + ("x", "y", "z")[best])
    lean = np.rad2deg(np.arccos(np.clip(axes.rows[2] @ nearest[2], -1.0, 1.0)))
    forward = nearest[0] - (nearest[0] @ axes.rows[2]) * axes.rows[2]
    turned = np.rad2deg(np.arctan2(forward @ axes.rows[1], forward @ axes.rows[0]))
    return {"up": names[0], "forward": names[1], "lean_deg": float(lean), "turned_deg": float(abs(turned))}
