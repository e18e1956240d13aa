r"""Strides detected from one gyroscope at the ankle or on the shank: a state machine, and a detector of swings.

Both take the sagittal rate with the forward swing *negative* (see `mounting.shank`). Each is a `lax.scan` of a step; a
device can call the step at each sample, in constant memory, with the same result. Both work under `vmap`. A stride is
reported at the sample at which the end of its swing is detected; its event times are those of the motion, without the
filter's delay, and are interpolated between samples where the rate crosses zero.

`phases` is the paper's machine on the causally filtered rate: FF → TO on a maximum above a threshold; TO → SW where
the rate becomes negative; SW → HS where it becomes positive again, a stride if the swing was fast enough; HS → FF on
the next maximum. `swings` takes each negative lobe of the rate as a swing if it was fast enough and turned the shank
far enough; with a rate filtered both ways it needs no push-off, so it also works for slow and impaired gait.

Source: H. D. Silva, J. A. Afonso, L. A. Rocha, "Walk distance estimation using an ankle-mounted inertial measurement
unit", 2017, section II-A and figure 1 (`phases`).

Deviations from the paper:
    Some are readings where the paper leaves a choice.

    1. The figure's "else" out of TO is read as a local minimum. Other readings count the same healthy strides.
    2. Event times have the filter's delay (54–56 ms) removed, and are interpolated to the zero crossing.
    3. A foot that stops has no zero crossing for 0.5 to 0.8 s. A swing also ends where its rate has stayed under a
       small part of its peak for `rest_s`; `rest_share` = 0 is the paper. Half-steps included, F1 of the machine rises
       from 0.979 to 0.995 (elderly of `walking5m`).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike
from jaxtyping import Bool, PyTree

from jgait.signal import butterworth
from jgait.types import Flags, Scalar, Values

FLAT, TOE_OFF, SWING, HEEL_STRIKE = range(4)
"""States of the paper's machine."""

RATES = (25.0, 400.0)
"""[Hz] Sampling rates for which the detectors are meant; lower ones lose the jolts of contacts. Chosen by hand."""


class Detector(NamedTuple):
    """Settings of both detectors; the defaults are those of the detector of swings."""

    cutoff_hz: Values = 6.0  #: cut-off of the low-pass filter [Hz]; causal for `phases`, both ways for `swings`.
    #: least peak rate of a push-off (`phases` only) and of a swing [rad/s].
    threshold: Values = np.deg2rad(70.0)
    least_angle: Values = np.deg2rad(13.0)  #: least angle of a swing [rad]; `swings` only.
    rest_share: Values = 0.1  #: share of a swing's peak rate below which the shank may be at rest [1]; 0: never.
    rest_s: Values = 0.15  #: time for which the rate must stay below that share [s].


LOBES = Detector()
"""The detector of swings."""

MACHINE = LOBES._replace(cutoff_hz=4.0, threshold=np.deg2rad(50.0))
"""The paper's machine, at 4 Hz and 50°/s, that also detects the end of a swing when the foot stops (deviation 3)."""

PAPER = MACHINE._replace(rest_share=0.0)
"""The paper's machine: the swing ends at the zero crossing alone."""


class ShankEvents(NamedTuple):
    """Output of a detector at every sample, (T,) or, online, a scalar."""

    stride: Flags  #: bool, a stride is detected at this sample.
    #: time of the last maximum of the rate before the swing [s]; from `swings`, the start of the swing.
    push_off: Values
    start: Values  #: time at which the forward swing of the shank begins [s].
    end: Values  #: time at which the forward swing ends [s], about the initial contact.
    peak: Values  #: greatest rate of the swing [rad/s], positive.
    angle: Values  #: angle of the swing [rad], positive; integral of the filtered rate.


class ShankState(NamedTuple):
    """State of a detector, passed from one sample to the next."""

    phase: PyTree  #: FLAT, TOE_OFF, SWING or HEEL_STRIKE.
    rising: Flags  #: 1 if the last change of the rate was a rise, −1 if it was a fall, 0 before any change.
    rate: Values  #: filtered rate of the previous sample [rad/s].
    time: Values  #: time of the previous sample [s].
    push_off: Values  #: as in `ShankEvents`, of the swing that may become a stride [s].
    start: Values  #: likewise [s].
    peak: Values  #: peak rate of the swing so far [rad/s].
    angle: Values  #: angle of the swing so far [rad].
    slack: Values  #: time at which the rate fell below `rest_share` of the peak [s].
    slackened: Flags  #: whether the rate is below that share.


def begin(rate: ArrayLike, time: ArrayLike) -> ShankState:
    """The state before the first sample, from its filtered rate [rad/s] and its time [s]."""
    x, t = jnp.asarray(rate), jnp.asarray(time)
    nothing, no = jnp.zeros_like(x), jnp.zeros_like(x, dtype=bool)
    none = jnp.zeros_like(x, dtype=jnp.int32)
    return ShankState(none + FLAT, none, x, t, t, t, nothing, nothing, t, no)


def _look(s: ShankState, x: Scalar, t: Scalar) -> tuple[Flags, Flags, Flags, Values, PyTree]:
    """Whether the previous sample was a maximum or a minimum; whether the rate crosses zero, and when; and `rising`."""
    change = x - s.rate
    rising = jnp.where(change > 0.0, 1, jnp.where(change < 0.0, -1, s.rising)).astype(jnp.int32)
    crossing = (x >= 0.0) != (s.rate >= 0.0)
    share = jnp.where(crossing, s.rate / jnp.where(crossing, s.rate - x, 1.0), 0.0)
    zero = s.time + share * (t - s.time)
    return (s.rising == 1) & (rising == -1), (s.rising == -1) & (rising == 1), crossing, zero, rising


def _swing_on(d: Detector, s: ShankState, x: Scalar, t: Scalar) -> tuple[ShankState, Bool[Array, ""]]:
    """The state with this sample added to the swing, and whether the shank has come to rest."""
    peak = jnp.maximum(s.peak, jnp.abs(x))
    angle = s.angle + 0.5 * (t - s.time) * (jnp.maximum(-x, 0.0) + jnp.maximum(-s.rate, 0.0))
    slackened = x > -d.rest_share * peak
    slack = jnp.where(slackened & ~s.slackened, t, s.slack)
    resting = slackened & s.slackened & (t - slack >= d.rest_s)
    return s._replace(peak=peak, angle=angle, slack=slack, slackened=slackened), resting


def _fresh(s: ShankState, where: Bool[Array, ""], start: Scalar) -> ShankState:
    """The state; where `where` is True, a new swing begins."""
    return s._replace(
        start=jnp.where(where, start, s.start),
        peak=jnp.where(where, 0.0, s.peak),
        angle=jnp.where(where, 0.0, s.angle),
        slackened=s.slackened & ~where,
    )


def phase_step(d: Detector, s: ShankState, rate: ArrayLike, time: ArrayLike) -> tuple[ShankState, ShankEvents]:
    """One sample of the paper's machine: the next state, and the events of this sample, with the delay of the filter.

    The rate is the filtered sagittal rate, the forward swing negative [rad/s], the time that of the sample [s].
    """
    x, t = jnp.asarray(rate), jnp.asarray(time)
    maximum, minimum, crossing, zero, rising = _look(s, x, t)
    swung, resting = _swing_on(d, s, x, t)
    flat, toe_off, swing, heel = (s.phase == p for p in (FLAT, TOE_OFF, SWING, HEEL_STRIKE))
    leaves = flat & maximum & (s.rate > d.threshold)
    swings_now = (leaves | toe_off) & crossing
    over = swing & (crossing | resting)
    stride = over & (swung.peak > d.threshold)
    end = jnp.where(crossing, zero, swung.slack)
    phase = jnp.where(leaves, TOE_OFF, s.phase)
    phase = jnp.where(toe_off & minimum & ~crossing, FLAT, phase)
    phase = jnp.where(swings_now, SWING, phase)
    phase = jnp.where(over, jnp.where(stride, HEEL_STRIKE, FLAT), phase)
    phase = jnp.where(heel & maximum, FLAT, phase).astype(jnp.int32)
    after = ShankState(*(jnp.where(swing, new, old) for new, old in zip(swung, s, strict=True)))
    push_off = jnp.where(leaves | (toe_off & maximum), s.time, s.push_off)
    after = after._replace(phase=phase, rising=rising, rate=x, time=t, push_off=push_off)
    return _fresh(after, swings_now, zero), ShankEvents(stride, s.push_off, s.start, end, swung.peak, swung.angle)


def swing_step(d: Detector, s: ShankState, rate: ArrayLike, time: ArrayLike) -> tuple[ShankState, ShankEvents]:
    """One sample of the detector of swings; arguments and result as in `phase_step`."""
    x, t = jnp.asarray(rate), jnp.asarray(time)
    _, _, crossing, zero, rising = _look(s, x, t)
    swung, resting = _swing_on(d, s, x, t)
    swing = s.phase == SWING
    starts = (x < 0.0) & ~swing & crossing
    over = swing & ((x >= 0.0) | resting)
    stride = over & (swung.peak > d.threshold) & (swung.angle > d.least_angle)
    end = jnp.where(crossing, zero, swung.slack)
    phase = jnp.where(starts, SWING, jnp.where(over, FLAT, s.phase)).astype(jnp.int32)
    after = ShankState(*(jnp.where(swing, new, old) for new, old in zip(swung, s, strict=True)))
    after = after._replace(phase=phase, rising=rising, rate=x, time=t)
    return _fresh(after, starts, zero), ShankEvents(stride, s.start, s.start, end, swung.peak, swung.angle)


def check_rate(sampling_rate_hz: float) -> None:
    """Raise ValueError if a sampling rate is outside `RATES`."""
    if not RATES[0] <= sampling_rate_hz <= RATES[1]:
        raise ValueError(f"the sampling rate must lie between {RATES[0]:g} and {RATES[1]:g} Hz; got {sampling_rate_hz}")


def phases(rate: ArrayLike, sampling_rate_hz: float, d: Detector = MACHINE) -> ShankEvents:
    """The paper's state machine over a recording; the filter and the machine run in one scan.

    The sagittal rate (T,) has a negative forward swing [rad/s]; a lost sample repeats the previous one. The events at
    each sample (T,) have times from the first sample on, without the filter's delay.

    Raises:
        ValueError: if the rate of the samples is not supported, or there are fewer than two.
    """
    values, time = _rates(rate, sampling_rate_hz)
    cascade = butterworth.section(d.cutoff_hz, sampling_rate_hz)
    late = butterworth.delay(d.cutoff_hz, sampling_rate_hz)

    def advance(carried: PyTree, sample: PyTree) -> PyTree:
        filtered, state = carried
        filtered, x = butterworth.step(cascade, filtered, sample[0])
        state, events = phase_step(d, state, x, sample[1])
        return (filtered, state), events

    first = (butterworth.at_rest(cascade, values[0]), begin(values[0], time[0]))
    events: ShankEvents = lax.scan(advance, first, (values, time))[1]
    return events._replace(push_off=events.push_off - late, start=events.start - late, end=events.end - late)


def swings(rate: ArrayLike, sampling_rate_hz: float, d: Detector = LOBES) -> ShankEvents:
    """The detector of swings over a recording (T,), on the rate filtered both ways: offline. Arguments and errors as of
    `phases`, but of at least 10 samples.
    """
    values, time = _rates(rate, sampling_rate_hz)
    values = jnp.asarray(butterworth.low_pass_both_ways(values, d.cutoff_hz, sampling_rate_hz))
    return lax.scan(lambda s, x: swing_step(d, s, *x), begin(values[0], time[0]), (values, time))[1]


def _rates(rate: ArrayLike, sampling_rate_hz: float) -> tuple[Array, Array]:
    """The checked rates, and their times [s]."""
    check_rate(sampling_rate_hz)
    values = jnp.asarray(rate)
    if values.ndim != 1 or values.shape[0] < 2:
        raise ValueError(f"rate must be (T,), the sagittal rate, with T >= 2; got shape {values.shape}")
    return values, jnp.arange(values.shape[0], dtype=values.dtype) / sampling_rate_hz
