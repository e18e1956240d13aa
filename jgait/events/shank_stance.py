r"""Instants at which the ankle rests: the valley of the shank's rate in each stance. Strides begin and end at them.

Between two swings the shank rolls over the foot; its rate is least after some 40 % of this time, when the ankle hardly
moves. The paper calls this instant the vertical event (the shank then leans by 4 to 12°). Before the first swing, after
the last swing and in a pause the person stands; the instant is then the still sample next to the swing. A stance
that the recording cuts off has no instant. `stances` searches a whole recording, on the host.

Online, in constant memory, the least rate since the swing is stored; while the foot comes down (`landing` samples),
each new greatest rate resets it. A sample whose rate has stayed the least for `hold` samples is the valley. Samples
from push-off to swing do not count. `step` processes one sample, in a `lax.scan` or on a device.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, PyTree, Shaped

from jgait.events.rest import LEGS_RATE, LEGS_SHORTEST_S
from jgait.signal.windows import true_runs
from jgait.types import AnyArray, Flags, Values, as_float

PAUSE_S = 1.5
"""[s] A longer time between two swings is a pause, if the shank rests in it; a stance lasts 0.7 s. Chosen by hand."""

RESTS = 1.5
"""[rad/s] Largest norm of the rate in a valley; shanks of recorded walks reach 1.4."""

SWINGS = 1.0
"""[rad/s] Forward rate above which a shank swings before the first or after the last whole swing; at the very end of
the recording the limit is `LEGS_RATE`. Beside a rest the norm of the rate must also exceed `RESTS`, because a shank
that straightens up is as fast. Chosen by hand."""

CUTOFF_HZ = 4.0
"""[Hz] Cut-off of the low-pass filter of the rates, applied both ways: that of the paper's machine."""


class ShankStances(NamedTuple):
    """The instants around each swing."""

    begin: np.ndarray  #: (n,) sample at which the stride of each swing begins.
    end: np.ndarray  #: (n,) sample at which the stride ends; except at pauses, the start of the next stride.
    standing: np.ndarray  #: (n, 2) bool, True where the start or the end lies in standing, False where it is a valley.
    rests: np.ndarray  #: (n, 2) bool, False where the recording's begin or end cuts the stance off.


def stances(
    rate: Float[AnyArray, "time"],
    speed: Float[AnyArray, "time"],
    start: Shaped[AnyArray, "swing"],
    end: Shaped[AnyArray, "swing"],
    sampling_rate_hz: float,
) -> ShankStances:
    """The instants before and after each swing at which the ankle rests.

    Args:
        rate: (T,) sagittal rate, the forward swing negative, low-passed at `CUTOFF_HZ` without delay [rad/s].
        speed: (T,) norm of the rate, its axes low-passed in the same way [rad/s].
        start: samples at which swings begin, whole or fractional, increasing.
        end: samples at which the swings end, each before the next start.
        sampling_rate_hz: sampling rate [Hz].

    Raises:
        ValueError: if swings overlap.
    """
    x, norm = as_float(rate), as_float(speed)
    first, last = (np.clip(np.rint(as_float(v)).astype(np.int64), 0, len(x) - 1) for v in (start, end))
    if np.any(last <= first) or np.any(first[1:] < last[:-1]):
        raise ValueError("every swing must end after it starts and before the next; these do not")
    n = len(first)
    before, after = np.zeros(n, np.int64), np.zeros(n, np.int64)
    standing, rests = np.zeros((n, 2), bool), np.ones((n, 2), bool)
    for k in range(n + 1):
        low = last[k - 1] if k > 0 else None
        high = first[k] if k < n else None
        if low is not None and high is not None and not _pauses(norm[low:high], sampling_rate_hz):
            after[k - 1] = before[k] = _valley(x, norm, low, high)
            continue
        if low is not None:
            after[k - 1], standing[k - 1, 1], rests[k - 1, 1] = _at_end(x, norm, low, 1, sampling_rate_hz, high)
        if high is not None:
            before[k], standing[k, 0], rests[k, 0] = _at_end(x, norm, high, -1, sampling_rate_hz, low)
    return ShankStances(before, after, standing, rests)


def _pauses(norm: np.ndarray, rate_hz: float) -> bool:
    """Whether the time between two swings, with this norm of the rate, is a pause."""
    rests = true_runs(norm < 0.1)  # [rad/s] in a very slow step a shank keeps turning
    return len(norm) > PAUSE_S * rate_hz and any(stop - start >= LEGS_SHORTEST_S * rate_hz for start, stop in rests)


def _valley(x: np.ndarray, norm: np.ndarray, low: int, high: int) -> int:
    """The sample of the valley between two swings: of the sagittal rate, or of the norm in a turn that hides it."""
    span = high - low
    first, last = low + int(0.12 * span), high - int((1.0 - 0.85) * span)  # between the peaks of landing and push-off
    last = max(last, first + 1)
    falls = np.flatnonzero(np.diff(x[first : low + int(0.4 * span)]) < 0.0)
    first += int(falls[0]) if falls.size else 0
    at = first + int(np.argmin(x[first:last]))
    return at if norm[at] <= RESTS else first + int(np.argmin(norm[first:last]))


def _at_end(
    x: np.ndarray, norm: np.ndarray, swing: int, way: int, rate_hz: float, limit: int | None
) -> tuple[int, bool, bool]:
    """The instant after a swing's end (1) or before its start (−1), whether it is in standing, and whether it rests.

    `limit` is the next swing after a pause, or None. Without one, the instant is a valley if an uncounted swing comes
    before the person rests, or if the recording begins or ends within a swing.
    """
    edge = (len(norm) - 1 if way > 0 else 0) if limit is None else limit
    near = int(0.1 * rate_hz)
    if limit is None:
        beside = norm[swing:] if way > 0 else norm[swing::-1]
        rest = next((a for a, b in true_runs(beside < LEGS_RATE) if b - a >= LEGS_SHORTEST_S * rate_hz), None)
        until = swing + way * np.arange(min(len(beside) if rest is None else rest, int(PAUSE_S * rate_hz) + 1))
        turns = (x[until] < -np.where(until == edge, LEGS_RATE, SWINGS)) & ((rest is None) | (norm[until] > RESTS))
        swings = np.flatnonzero(turns[near:])
        stance = until[: near + swings[0]] if len(swings) else until[:0]
        stance = stance[x[stance] >= 0.0]
        if len(stance) > near:
            at = _valley(x, norm, *sorted((swing, int(stance[-1]))))
            return at, False, bool(norm[at] <= RESTS)
    index = swing + way * np.arange(near, max(int(0.9 * rate_hz), near + 1))
    index = index[index <= edge] if way > 0 else index[index >= edge]
    if len(index) == 0:
        return edge, True, False
    rates = norm[index]
    first_still = int(np.argmax(rates < max(LEGS_RATE, 1.2 * float(rates.min()))))
    at = int(index[first_still])
    outside = (
        norm[min(at, edge - near) : at + near + 1] if way > 0 else norm[max(at - near, 0) : max(at, edge + near) + 1]
    )
    return at, True, bool(norm[at] <= SWINGS and (outside <= RESTS).all())


class StanceSearch(NamedTuple):
    """State of the search, passed from one sample to the next."""

    seeks: PyTree  #: bool, the valley of this stance is not detected yet.
    since: Values  #: sample at which the end of the swing was detected.
    most: Values  #: greatest rate since that sample while the foot came down [rad/s].
    least: Values  #: least rate since the greatest rate [rad/s].
    at: Values  #: sample of the least rate.


class Phase(NamedTuple):
    """Output of a detector of `events.shank` at the sample."""

    over: Flags  #: bool, the end of a swing is detected.
    leaves: Flags  #: bool, the foot pushes off or swings.


def begin(rate: ArrayLike) -> StanceSearch:
    """The state before the first swing; `rate` is the rate of the first sample [rad/s]."""
    x = jnp.asarray(rate)
    none = jnp.zeros_like(x, dtype=jnp.int32)
    return StanceSearch(jnp.zeros_like(x, dtype=bool), none, x, x, none)


def step(
    s: StanceSearch, index: ArrayLike, rate: ArrayLike, phase: Phase, hold: ArrayLike, landing: ArrayLike
) -> tuple[StanceSearch, PyTree]:
    """One sample: the next state, and whether the sample `state.at` is now detected as a valley.

    The rate is low-passed, the forward swing negative [rad/s]; the rate of a valley stays the least for `hold` samples,
    and the foot comes down in the `landing` samples after a swing.
    """
    now, x = jnp.asarray(index, jnp.int32), jnp.asarray(rate)
    since = jnp.where(phase.over, now, s.since)
    lands = now - since < landing
    rises = phase.over | (lands & (x >= s.most))
    most = jnp.where(rises, x, s.most)
    lower = rises | ((x < s.least) & ~phase.leaves)
    least, at = jnp.where(lower, x, s.least), jnp.where(lower, now, s.at)
    valley = s.seeks & ~lands & (now - at >= hold)
    return StanceSearch((s.seeks | phase.over) & ~valley, since, most, least, at), valley
