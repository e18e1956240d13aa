"""When a foot stands and when it leaves and meets the ground, from the sensor on it; on the host.

A fixed threshold on the angular rate loses stances of fast gait, where the foot never comes to rest, and finds false
ones in slow swings. Here the threshold follows the stride: a stance is a valley of the rate between two swings that
are `RATIO` times as high, and its threshold is its own lowest rate times a factor. Only magnitudes are used, so the
sensor may be mounted in any way.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, PyTree

from jgait.types import AnyArray

WINDOW = 0.1
"""[s] Over which the root mean square of the rate is taken."""

RATIO = 3.0
"""How much higher than the valley a swing has to be [1]."""

SWING = 1.2
"""[rad/s] The least rate of a swing; a foot in swing reaches 4 to 12, one that is dragged along 2."""

STANCE = 2.5
"""[rad/s] The highest rate at which a foot may still count as standing: the valley of a run."""

STILL = 0.8
"""[rad/s] Below this a foot stands in any case; between heel-off and contact the rate is above 2."""

JOLT = 5.0
"""[m/s²] Spread of the specific force that counts as much as 1 rad/s."""

SHORTEST = 0.45
"""[s] From one stance to the next; a run has 0.65."""

WORSE = 3.0
"""How many times its neighbours' rate a valley between them may have, if all three lie within `LONGEST` [1]."""

LONGEST = 2.0
"""[s] Two strides of fast walking; see `WORSE`."""


LANDED = 0.1
"""Share of their height by which the toes have come down when the heel meets the ground [1]."""

REACH = 0.25
"""[s] Contacts are looked for from so long before a foot is last seen to stand, to as long after it is seen again."""

EROSION = (0.06, 0.02)
"""[s] A foot that has just been set down still comes down: taken for still, every foothold is 5 mm too high."""


class Stances(NamedTuple):
    """Stances of one foot, in order; every field is (n,).

    Attributes:
        start: first sample at which it stands [samples].
        end: one past the last [samples].
        stillest: where the rate is least [samples].
        rate: root mean square rate there [rad/s].
    """

    start: np.ndarray
    end: np.ndarray
    stillest: np.ndarray
    rate: np.ndarray


def moving_rate(gyr: Float[AnyArray, "time 3"], sampling_rate_hz: float, window_s: float = WINDOW) -> np.ndarray:
    """Root mean square of the angular rate over a centred window (T,) [rad/s]; the ends are repeated."""
    size = max(3, 2 * round(window_s * sampling_rate_hz / 2) + 1)
    half = size // 2
    power = np.pad((np.asarray(gyr, np.float64) ** 2).sum(axis=1), (half, half), mode="edge")
    total = np.concatenate([[0.0], np.cumsum(power)])
    return np.sqrt(np.maximum(total[size:] - total[:-size], 0.0) / size)


def unrest(
    gyr: Float[AnyArray, "time 3"], acc: Float[AnyArray, "time 3"], sampling_rate_hz: float, window_s: float = WINDOW
) -> np.ndarray:
    """√(ω² + (σ_f / `JOLT`)²) (T,) [rad/s]: the rate, and the spread of the specific force, over a centred window."""
    size = max(3, 2 * round(window_s * sampling_rate_hz / 2) + 1)
    force = np.asarray(acc, np.float64)
    force = np.pad(force - force.mean(axis=0), ((size // 2, size // 2), (0, 0)), mode="edge")

    def mean(values: np.ndarray) -> np.ndarray:
        total = np.concatenate([np.zeros((1, 3)), np.cumsum(values, axis=0)])
        return (total[size:] - total[:-size]) / size

    variance = np.maximum(mean(force**2) - mean(force) ** 2, 0.0).sum(axis=1)
    return np.sqrt(moving_rate(gyr, sampling_rate_hz, window_s) ** 2 + variance / JOLT**2)


def stances(
    gyr: Float[AnyArray, "time 3"],
    acc: Float[AnyArray, "time 3"],
    sampling_rate_hz: float,
    *,
    still: float = STILL,
    factor: float = 1.5,
    erosion_s: tuple[float, float] = EROSION,
) -> Stances:
    """Where a foot stands, at any speed of gait.

    Args:
        gyr: (T, 3) angular rate, without the gyroscope's bias as far as it is known [rad/s], finite.
        acc: (T, 3) specific force [m/s²], finite; a foot that comes down without turning is told by it.
        sampling_rate_hz: rate of the samples [Hz].
        still: a stance reaches from its valley to where the rate passes this [rad/s],
        factor: or this many times the valley's own rate, whichever is more [1].
        erosion_s: by how much its start and its end are then drawn in [s], except at the ends of the recording.

    Returns:
        The stances; empty if the foot never moves enough, or never comes to rest.
    """
    rate, restless = moving_rate(gyr, sampling_rate_hz), unrest(gyr, acc, sampling_rate_hz)
    valleys = _suppressed(*_valleys(rate), sampling_rate_hz)
    after_start, before_end = (round(seconds * sampling_rate_hz) for seconds in erosion_s)
    rows = []
    borders = np.concatenate([[-1], valleys, [len(rate)]])
    for before, at, after in zip(borders[:-2], valleys, borders[2:], strict=True):
        first, last = _around(rate, at, (before + 1, after), max(still, factor * rate[at]))
        first = min(first + after_start, at) if first > 0 else first
        last = max(last - before_end, at) if last < len(rate) - 1 else last
        middle = first + int(np.argmin(restless[first : last + 1]))
        limit = max(still, factor * restless[middle])
        first, last = _around(restless, middle, (first, last + 1), limit)
        rows.append((first, last + 1, middle))
    start, end, stillest = np.array(rows, int).reshape(-1, 3).T
    return Stances(start, end, stillest, rate[stillest])


def _around(values: np.ndarray, at: int, within: tuple[int, int], limit: float) -> tuple[int, int]:
    """First and last sample of the stretch about one in which values stay below a limit."""
    before, after = values[within[0] : at] >= limit, values[at + 1 : within[1]] >= limit
    first = at - int(np.argmax(before[::-1])) if before.any() else within[0]
    last = at + int(np.argmax(after)) if after.any() else within[1] - 1
    return first, last


def _valleys(rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples and depths of the valleys between swings."""
    size = 1024 * 2 ** max(0, int(np.ceil(np.log2(len(rate) / 1024))))
    padded = np.full(size, rate[-1])
    padded[: len(rate)] = rate
    confirmed, at, last = (np.asarray(values) for values in _turning_points(jnp.asarray(padded)))
    found = at[confirmed]
    # the valley that the recording ends in
    if last >= 0:
        found = np.append(found, last)
    found = found[(found < len(rate)) & (rate[np.minimum(found, len(rate) - 1)] < STANCE)]
    return found.astype(int), rate[found]


@jax.jit
def _turning_points(rate: Float[Array, "time"]) -> PyTree:
    """One pass over the rate: valleys confirmed by a swing, swings by falling again.

    Returns:
        (T,) bool where a valley is confirmed, (T,) where it was, and the valley that is open at the end or −1.
    """

    def step(carry: PyTree, item: PyTree) -> PyTree:
        seeking, extreme, at = carry
        index, value = item
        lower = seeking & (value < extreme)
        higher = ~seeking & (value > extreme)
        extreme = jnp.where(lower | higher, value, extreme)
        at = jnp.where(lower, index, at)
        swing = seeking & (value > jnp.maximum(RATIO * extreme, SWING))
        valley = ~seeking & (value < extreme / RATIO)
        turned = (jnp.where(swing, False, jnp.where(valley, True, seeking)), jnp.where(swing | valley, value, extreme))
        return (*turned, jnp.where(valley, index, at)), (swing, at)

    indices = jnp.arange(rate.shape[0])
    start = (jnp.asarray(True), jnp.asarray(jnp.inf, rate.dtype), indices[0])
    (seeking, _, at), (confirmed, where) = lax.scan(step, start, (indices, rate))
    return confirmed, where, jnp.where(seeking, at, -1)


def _suppressed(valleys: np.ndarray, rate: np.ndarray, sampling_rate_hz: float) -> np.ndarray:
    """Without the valleys of swings: too near a deeper one, or much worse than both neighbours."""
    kept, depth = list(valleys), list(rate)
    while len(kept) > 1:
        gaps = np.diff(kept) / sampling_rate_hz
        close = int(np.argmin(gaps))
        if gaps[close] >= SHORTEST:
            break
        drop = close if depth[close] > depth[close + 1] else close + 1
        del kept[drop], depth[drop]
    k = 1
    while k < len(kept) - 1:
        near = (kept[k + 1] - kept[k - 1]) / sampling_rate_hz < LONGEST
        if near and depth[k] > WORSE * max(depth[k - 1], depth[k + 1], 0.1):
            del kept[k], depth[k]
        else:
            k += 1
    return np.array(kept, int)


def inside(found: Stances, samples: int) -> np.ndarray:
    """(T,) bool: whether the foot stands."""
    change = np.zeros(samples + 1, int)
    np.add.at(change, found.start, 1)
    np.add.at(change, found.end, -1)
    return np.cumsum(change[:-1]) > 0


def contacts(gyr: Float[AnyArray, "time 3"], found: Stances, sampling_rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Final and initial contact of every stride, between one stance and the next.

    The toes leave where the foot is pitched down most, after the heel has risen. The heel has met the ground when the
    toes have come down by `LANDED` from the highest that they were raised in late swing: soft landings have no jolt
    that swing would not have too. Pitch is the integral of the rate about the axis that the foot mostly turns about, so
    any mounting will do.

    Args:
        gyr: (T, 3) angular rate without bias [rad/s].
        found: from `stances`, n of them.
        sampling_rate_hz: rate of the samples [Hz].

    Returns:
        Samples of the final contact and of the initial contact, each (n − 1,).
    """
    gyr = np.asarray(gyr, np.float64)
    count = max(len(found.stillest) - 1, 0)
    final, initial = np.zeros(count, int), np.zeros(count, int)
    if not count:
        return final, initial
    swinging = ~inside(found, len(gyr))
    axis = np.linalg.eigh(gyr[swinging].T @ gyr[swinging])[1][:, -1]
    about = gyr @ axis
    reach = int(REACH * sampling_rate_hz)
    for k in range(count):
        a = max(found.stillest[k], found.end[k] - reach)
        b = min(found.stillest[k + 1], found.start[k + 1] + reach)
        pitch = np.cumsum(about[a:b]) / sampling_rate_hz
        pitch -= np.linspace(0.0, pitch[-1], b - a)
        down, up = sorted((int(np.argmax(pitch)), int(np.argmin(pitch))))
        lower = np.flatnonzero(pitch[up:] / pitch[up] < 1.0 - LANDED) if pitch[up] else np.zeros(0, int)
        final[k] = a + down
        initial[k] = min(a + up + (lower[0] if lower.size else 0), b - 1)
    return final, initial
