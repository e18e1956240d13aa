r"""Initial contacts of both feet, and the side of each contact, from one sensor on the trunk.

Three detectors share coarse instants (`events.trunk_rhythm`), arguments and result. They compute the contact near a
coarse instant as:

- `PaperRule`: the middle between the greatest forward acceleration, rebuilt from its wavelet details, and the first
  negative local minimum of the upward acceleration after it.
- `Peaks`: a constant time after the peak of the forward acceleration, low-passed near the step frequency.
- `Soft` (the default): a soft argmax over both accelerations' rates of change and the blow of the foot, differentiable,
  with settings that can be learned.

At initial contact the trunk is braked and pushed up: the forward acceleration a falls, the upward acceleration v rises,
both within some 40 ms, and the blow of the foot reaches the trunk. With a and v low-passed, their rates of change and
the envelope b of what is faster than a step's motion, each divided by its local root mean square, the score of an
instant u after a coarse instant is

    s(u) = (w_v v̇(u) / |v̇| − w_a ȧ(u) / |ȧ| + w_b b(u) / |b|) / τ − (u − c)² / (2 σ²),
    contact = coarse + Σ u e^s / Σ e^s − δ − λ T,

over |u| <= 0.2 s, with the step time T: the longer a step, the later the foot is loaded. Either acceleration alone has
larger errors (`experiments/kose2011`). For given coarse instants, which carry no gradient, the contact is
differentiable in the signals and in each setting.

Sides are computed from three cues, whose parts that alternate from step to step are compared:

- Sway: from a right contact to the next contact the right foot alone carries the trunk, and accelerates it to the left.
- Drop: when the right foot takes the weight, the left side of the pelvis falls, in the first third of the step.
- Turn: the hip of the swing leg moves forward with the leg; in some people it turns the other way, or hardly.

Because sides alternate, each side is computed from all contacts in a chain of two states, one chain for a cue; near
contacts weigh most. A cue may be exchanged for a person, so one cue alone never makes a side certain, and cues that
disagree leave it unknown.

Everything has a fixed number of rows, and is usable under `jit` and `vmap` (settings of `PaperRule` are static). On
NumPy's arrays it computes on the host.

Source: A. Köse, A. Cereatti, U. Della Croce, "Estimation of traversed distance in level walking using a single inertial
measurement unit attached to the waist", 2011, section 2.1a (`PaperRule`).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike
from jaxtyping import Int, PyTree

from jgait.events.shank import check_rate
from jgait.events.trunk_rhythm import SLOWEST, Rhythm, contacts_nearby
from jgait.geometry.arrays import as_given, of_jax, xp
from jgait.signal import butterworth, wavelet
from jgait.signal.windows import between_samples, moving_mean, vertex, window_size
from jgait.types import AnyArray, Flags, Scalar, Values

PAPER_RATE = 100.0
"""[Hz] Sampling rate of the paper's wavelet; recordings with another rate are interpolated to it."""


class PaperRule(NamedTuple):
    """Settings of the paper's detector; static."""

    shares: tuple[float, ...] = (1 / 5, 1 / 4, 1 / 3)  #: thresholds of details 1, 2 and 3, as shares of their size [1].
    relative_to: str = "rms"  #: see `wavelet.from_details`, as `hard`.
    hard: bool = False
    before: float = 0.20  #: search interval about the peak of the low-passed forward acceleration [s].
    after: float = 0.15  #: likewise [s].
    minimum: float = 0.20  #: longest time from the maximum to the minimum; without one the contact is the maximum [s].
    offset: float = 0.0  #: time subtracted from the instant [s].


class Peaks(NamedTuple):
    """Setting of the baseline."""

    #: time subtracted from the peak; negative, because the contact comes later than the peak [s].
    offset: Values = -0.105


class Soft(NamedTuple):
    """Settings of the soft detector; all can be learned by gradient."""

    forward: Values = 1.0  #: weight of the fall of the forward acceleration, w_a [1].
    upward: Values = 1.0  #: weight of the rise of the upward acceleration, w_v [1].
    blow: Values = 1.0  #: weight of the envelope of the fast accelerations, w_b [1].
    temperature: Values = 0.6  #: τ [1]; with a smaller τ the soft argmax is nearer to the maximum.
    centre: Values = -0.035  #: centre of the search, after the coarse instant, c [s].
    width: Values = 0.03  #: standard deviation of the search about its centre, σ [s].
    offset: Values = -0.032  #: delay of the score, which is subtracted, δ [s].
    loading: Values = 0.095  #: delay as a share of the step time, which is subtracted too, λ [1].
    cutoff_hz: Values = 12.0  #: cut-off of the low-pass filter [Hz].


SOFT = Soft()
"""Equal weights; the centre is how late coarse instants are. `offset` and `loading` are those of 12 people of
`ipol_gait`; learned on 11 of them, they leave the twelfth a mean error of 15 ms. Cut-offs of 10 to 16 Hz, temperatures
of 0.3 to 0.9, widths of 25 to 35 ms change errors by less than 1 ms."""


class Contacts(NamedTuple):
    """Initial contacts in order; every field is (capacity,), 0 where a row is not valid."""

    time: Values  #: time of the contact [s].
    side: Int[AnyArray, "..."]  #: 0 right, 1 left; the order of `SIDES`.
    valid: Flags  #: bool; False for a row without a contact.
    coarse: Values  #: the coarse instant near which the contact was computed [s].
    step_frequency: Values  #: step frequency at the contact [Hz].
    certainty: Values  #: probability of the side minus that of the other side, 0 … 1 [1].


def _near(
    x: AnyArray, about: AnyArray, before: Values, after: Values, reach: tuple[float, float], rate: float
) -> PyTree:
    """Samples about instants: indices (n, k), values, and whether they lie within `before` and `after` [s]."""
    span = np.arange(-int(np.ceil(reach[0] * rate)) - 1, int(np.ceil(reach[1] * rate)) + 2, dtype=np.int32)
    index = xp.round(about * rate).astype(np.int32)[:, None] + span[None, :]
    late = index.astype(x.dtype) / rate - about[:, None]
    first, last = (xp.broadcast_to(xp.asarray(b, x.dtype), about.shape)[:, None] for b in (before, after))
    inside = (late >= -first) & (late <= last) & (index >= 0) & (index < x.shape[0])
    return index, x[xp.clip(index, 0, x.shape[0] - 1)], inside


def _greatest(
    x: AnyArray, about: AnyArray, before: Values, after: Values, reach: tuple[float, float], rate: float
) -> PyTree:
    """The time of the signal's maximum near each instant [s], interpolated by a parabola."""
    index, values, inside = _near(x, about, before, after, reach, rate)
    rows, at = np.arange(about.shape[0]), xp.argmax(xp.where(inside, values, -xp.inf), axis=1)
    place = index[rows, at]
    three = (x[xp.clip(place + k, 0, x.shape[0] - 1)] for k in (-1, 0, 1))
    return (place.astype(x.dtype) + vertex(*three)) / rate


def _peaks(rhythm: Rhythm, rate: float) -> AnyArray:
    """The time of the peak of the low-passed forward acceleration before each coarse instant [s]."""
    step = 1.0 / rhythm.frequency
    return _greatest(rhythm.forward, rhythm.time, 0.6 * step, 0.05 * step, (0.6 / SLOWEST, 0.05 / SLOWEST), rate)


def details(accelerations: ArrayLike, mask: ArrayLike, sampling_rate_hz: float, p: PaperRule) -> Array:
    """Accelerations (N, n) at `PAPER_RATE` [m/s²], rebuilt from the thresholded wavelet details of the paper;
    `accelerations` (T, n) are finite, `mask` (T,) is False where a sample was lost.
    """
    rate, both = sampling_rate_hz, jnp.asarray(accelerations)
    if rate > PAPER_RATE:
        both = jnp.asarray(butterworth.low_pass_both_ways(both, 0.4 * PAPER_RATE, rate))
    count = int(both.shape[0] * PAPER_RATE / rate)
    place = jnp.asarray(np.minimum(np.arange(count) * rate / PAPER_RATE, both.shape[0] - 1), both.dtype)
    every = jnp.arange(both.shape[0], dtype=both.dtype)
    sampled = jnp.stack([jnp.interp(place, every, both[:, k]) for k in range(both.shape[1])], axis=1)
    counts = jnp.asarray(mask)[jnp.round(place).astype(jnp.int32)]
    return wavelet.from_details(sampled, p.shares, relative_to=p.relative_to, hard=p.hard, mask=counts)


@partial(jax.jit, static_argnames=("rate", "p"))
def _paper(forward: Array, upward: Array, mask: Array, rhythm: Rhythm, rate: float, p: PaperRule) -> Array:
    """The middle between the maximum of the forward and the next minimum of the upward acceleration [s]."""
    kept = details(jnp.stack([forward, upward], axis=1), mask, rate, p)
    count = kept.shape[0]
    greatest = _greatest(kept[:, 0], _peaks(rhythm, rate), p.before, p.after, (p.before, p.after), PAPER_RATE)
    index, values, inside = _near(kept[:, 1], greatest, 0.0, p.minimum, (0.0, p.minimum), PAPER_RATE)
    before, after = (kept[jnp.clip(index + k, 0, count - 1), 1] for k in (-1, 1))
    low = inside & (values < 0.0) & (values <= before) & (values < after)
    first = index[np.arange(index.shape[0]), jnp.argmax(low, axis=1)].astype(kept.dtype) / PAPER_RATE
    return 0.5 * (greatest + jnp.where(low.any(axis=1), first, greatest)) - p.offset


def cues(
    forward: AnyArray, upward: AnyArray, sampling_rate_hz: float, cutoff_hz: Scalar, mask: AnyArray | None = None
) -> AnyArray:
    """Rates of change of −forward and of upward acceleration, low-passed, and the blow: (T, 3), each divided by its
    local root mean square. The accelerations are (T,) [m/s²]; where `mask` is False a sample does not count.
    """
    rate, both = sampling_rate_hz, xp.stack([-forward, upward], axis=1)
    slow, blunt = butterworth.low_passed(both, (cutoff_hz, 10.0), rate)  # [Hz] above it is the impact of the foot
    slope = xp.gradient(slow, axis=0)
    fast = both - blunt
    blow = butterworth.low_pass_both_ways(xp.sqrt((fast * fast).sum(axis=1, keepdims=True) + 1e-6), cutoff_hz, rate)
    columns = xp.concatenate([slope * rate, blow], axis=1)
    size = min(window_size(3.0, rate), 2 * (columns.shape[0] // 2) - 1)  # [s] several steps
    counts = xp.ones_like(columns[:, 0]) if mask is None else mask.astype(columns.dtype)
    counts = counts[:, None] * xp.ones_like(columns)
    weight = moving_mean(counts, size)
    power = moving_mean(columns * columns * counts, size) / xp.maximum(weight, 1.0 / size)
    return columns / xp.sqrt(power + 1.0**2)  # the score of standing still is finite


def located(
    score: AnyArray, sampling_rate_hz: float, coarse: AnyArray, step_frequency: AnyArray, settings: Soft = SOFT
) -> AnyArray:
    """The contact near each coarse instant (n,) [s]: times from the first sample on, from `cues` (T, 3) with the
    cut-off of the settings, and step frequencies (n,) [Hz].
    """
    about, last = xp.asarray(coarse, score.dtype), score.shape[0] - 1
    # [s] up to a fifth of a second before and after; the same for every sampling rate, which then hardly matters
    later = np.asarray(0.01 * np.arange(-20, 21), score.dtype)
    place = (about[:, None] + later[None, :]) * sampling_rate_hz
    cues_at = between_samples(score, place)
    aside = (later - settings.centre) / settings.width
    weights = (settings.forward, settings.upward, settings.blow)
    logits = sum(weight * cues_at[..., k] for k, weight in enumerate(weights)) / settings.temperature
    logits = xp.where((place >= 0.0) & (place <= last), logits - 0.5 * (aside * aside)[None, :], -xp.inf)
    weight = xp.exp(logits - xp.max(logits, axis=1, keepdims=True))
    late = (weight * later[None, :]).sum(axis=1) / weight.sum(axis=1)
    step = 1.0 / xp.maximum(xp.asarray(step_frequency, score.dtype), 0.1)
    return about + late - settings.offset - settings.loading * step


def sides(
    time: AnyArray, frequency: AnyArray, valid: AnyArray, sampling_rate_hz: float, yaw_rate: AnyArray,
    leftward: AnyArray | None = None, roll_rate: AnyArray | None = None,
) -> PyTree:  # fmt: skip
    """The side of each contact, as log odds (n,) that the contact is of the left foot [1].

    Each cue is an integral over its part of the step after the contact, less the mean of the steps before and after.
    Its log odds pass from contact to contact, change sign at every step between them, and are reduced where the time
    between contacts is no whole number of steps. Cues that are known are independent, and each may be exchanged. Times
    [s], step frequencies [Hz] and validity of contacts are (n,); other arguments are those of `initial_contacts`.
    """
    at, f, there = time, frequency, valid
    # signal, its part of the step after the contact [steps], and the share of people in whom left and right are
    # exchanged: no person of 14 has sway or drop exchanged (1/16 by Laplace's rule), three the turn
    known = [(yaw_rate, (0.4, 1.4), 1 / 4)]
    known += [] if leftward is None else [(-leftward, (0.0, 1.0), 1 / 16)]
    known += [] if roll_rate is None else [(roll_rate, (0.0, 0.3), 1 / 16)]
    says = xp.stack([_leans(signal, at, f, there, sampling_rate_hz, part) for signal, part, _ in known])
    both_ways = [xp.stack([v, v[..., ::-1]]) for v in (at, f, says, there)]
    before, after = as_given(_chains(*both_ways), *both_ways)
    after = after[:, ::-1]
    kept = np.asarray([1.0 - 2.0 * exchanged for *_, exchanged in known], at.dtype)[:, None]
    return 2.0 * xp.arctanh(kept * xp.tanh(0.5 * (before + says + after))).sum(axis=0)


@jax.jit
def _chains(time: Array, frequency: Array, says: Array, valid: Array) -> Array:
    """Log odds (2, cues, n) that pass to each contact from those before it, of two orders of the contacts (2, n)."""

    def step(carry: PyTree, item: PyTree) -> PyTree:
        odds, before = carry
        t, often, evidence, some = item
        steps = jnp.abs(t - before) * often
        whole = jnp.maximum(1.0, jnp.round(steps))
        sure = (1.0 - 2.0 * 0.02) ** whole * jnp.maximum(0.0, 1.0 - 4.0 * (steps - whole) ** 2)
        passed = 2.0 * jnp.arctanh(sure * jnp.tanh(0.5 * odds)) * jnp.where(whole % 2.0 == 0.0, 1.0, -1.0)
        after = (jnp.where(some, passed + evidence, odds), jnp.where(some, t, before))
        return after, jnp.where(some, passed, 0.0)

    def chain(at: Array, f: Array, says: Array, there: Array) -> Array:
        start = (jnp.zeros_like(says[:, 0].T), at[0])
        passed: Array = lax.scan(step, start, (at, f, says.T, there))[1]
        return passed.T

    return jax.vmap(chain)(time, frequency, says, valid)


def _leans(
    signal: AnyArray, at: AnyArray, f: AnyArray, there: AnyArray, rate: float, part: tuple[float, float]
) -> AnyArray:
    """(n,) log odds from one cue at each contact alone, see `sides`; `signal` (T,) is greater after left contacts."""
    total = xp.cumsum(signal - signal.mean()) / rate
    steps = np.arange(-1, 2, dtype=signal.dtype)[:, None] + np.asarray(part, signal.dtype)[None, :]
    place = rate * (at[None, None] + steps[..., None] / f[None, None])
    begun, ended = xp.moveaxis(between_samples(total, place), 1, 0)
    gained = ended - begun
    counts = there.astype(signal.dtype)
    leans = (gained[1] - 0.5 * (gained[0] + gained[2])) * counts
    nine = xp.ones(9, signal.dtype)
    power = xp.convolve(leans * leans, nine, "full")[4:-4] / xp.maximum(xp.convolve(counts, nine, "full")[4:-4], 1.0)
    says: AnyArray = 0.5 * xp.tanh(leans / xp.sqrt(power + 1e-12))
    return says


def initial_contacts(
    forward: AnyArray, upward: AnyArray, yaw_rate: AnyArray, sampling_rate_hz: float,
    settings: PaperRule | Peaks | Soft = SOFT, *, mask: AnyArray | None = None, leftward: AnyArray | None = None,
    roll_rate: AnyArray | None = None,
) -> Contacts:  # fmt: skip
    """Initial contacts of both feet from the trunk's accelerations, without gravity, in the body's axes.

    Args:
        forward: (T,) acceleration along the walking direction [m/s²], finite.
        upward: (T,) acceleration, without gravity [m/s²], finite.
        yaw_rate: (T,) about the vertical, a turn to the left positive [rad/s], finite.
        sampling_rate_hz: sampling rate [Hz], 25 to 400; static.
        settings: settings of a detector, which also choose the detector.
        mask: (T,) bool, False where a sample was lost or is padding; None: all count.
        leftward: (T,) acceleration to the left, without gravity [m/s²], finite; None: not known. It and `roll_rate`
            tell sides, which by the yaw rate alone are wrong for some people, and quick steps from slow strides.
        roll_rate: (T,) about the walking direction, the left side rising [rad/s], finite; None: not known.

    Returns:
        The contacts, times from the first sample on, four rows for every second; further contacts are left out.
        Without walking no row is valid.

    Raises:
        ValueError: signals not of one length of at least 10 samples, or a sampling rate that is not supported.
    """
    check_rate(sampling_rate_hz)
    given = {"forward": forward, "upward": upward, "yaw_rate": yaw_rate, "leftward": leftward, "roll_rate": roll_rate}
    signals = {name: xp.asarray(x) for name, x in given.items() if x is not None}
    for name, x in signals.items():
        if x.ndim != 1 or x.shape != signals["forward"].shape or x.shape[0] < 10:
            raise ValueError(f"{', '.join(given)} must all be (T,), T >= 10; {name} has shape {x.shape}")
        if not np.issubdtype(x.dtype, np.floating):
            raise ValueError(f"{name} must be floating point; got {x.dtype}")
    counts = xp.ones_like(signals["forward"], dtype=bool) if mask is None else mask
    signals = {name: xp.where(counts, x, 0.0).astype(x.dtype) for name, x in signals.items()}
    ahead, up = signals["forward"], signals["upward"]
    rate = float(sampling_rate_hz)
    aside = signals.get("leftward", xp.zeros_like(up))
    rows = int(4.0 * ahead.shape[0] / rate) + 2
    rhythm = _decided(contacts_nearby(ahead, up, aside, rate, rows))
    if isinstance(settings, PaperRule):
        time = as_given(_paper(ahead, up, counts, rhythm, rate, settings), ahead)
    elif isinstance(settings, Peaks):
        time = _peaks(rhythm, rate) - settings.offset
    else:
        score = cues(ahead, up, rate, settings.cutoff_hz, counts)
        time = located(score, rate, rhythm.time, rhythm.frequency, settings)
    of_sides = (signals["yaw_rate"], signals.get("leftward"), signals.get("roll_rate"))
    odds = _decided(sides(rhythm.time, rhythm.frequency, rhythm.valid, rate, *of_sides))
    side, certainty = (odds > 0.0).astype(np.int32), xp.tanh(0.5 * xp.abs(odds))
    contacts = Contacts(time, side, rhythm.valid, rhythm.time, rhythm.frequency, certainty)
    return Contacts(*(xp.where(rhythm.valid, field, xp.zeros_like(field)) for field in contacts))


def _decided(values: PyTree) -> PyTree:
    """The values without gradient."""
    return jax.tree.map(lambda value: lax.stop_gradient(value) if of_jax(value) else value, values)
