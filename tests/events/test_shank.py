"""Strides told from a shank's rate: known swings, online as offline, sensors worn wrongly, and what is refused."""

import jax
import numpy as np
import pytest

from jgait import simulate
from jgait.events import shank as shank_events
from jgait.events import shank_stance
from jgait.mounting import shank as shank_axes
from jgait.signal import butterworth
from jgait.types import Imu, RecordingError

RATE, PERIOD, STRIDES, FIRST = 100.0, 1.2, 6, 2.0
SAMPLES = 1024
TIME = np.arange(SAMPLES) / RATE


def bump(time, middle, width):
    return np.exp(-0.5 * ((time - middle) / width) ** 2)


def sagittal(time, *, slow=1.0, stop=True):
    """A rate with a push-off, a forward swing (negative) and a landing each stride; the last foot stops softly."""
    rate = np.zeros_like(time)
    for k in range(STRIDES):
        at = FIRST + k * PERIOD
        rate += slow * (3.0 * bump(time, at - 0.26, 0.06) - 6.0 * bump(time, at, 0.09))
        if not (stop and k == STRIDES - 1):
            rate += slow * 2.5 * bump(time, at + 0.24, 0.05)
    return rate


def worn(rows):
    """A sensor on that shank, turned: `rows` are the segment's axes in the sensor's."""
    gyr = np.stack([0.1 * np.sin(9.0 * TIME), sagittal(TIME), 0.1 * np.cos(7.0 * TIME)], axis=1)
    gyr = np.where(np.abs(gyr[:, 1:2]) > 0.05, gyr, 0.0)
    acc = np.tile([0.0, 0.0, 9.81], (SAMPLES, 1))
    return Imu(TIME, gyr @ rows, acc @ rows, np.ones(SAMPLES, bool))


phases = jax.jit(shank_events.phases, static_argnums=1)
swings = jax.jit(shank_events.swings, static_argnums=1)


@pytest.mark.parametrize("detector", [phases, swings])
def test_every_swing_is_found_when_it_happens(detector):
    found = detector(sagittal(TIME), RATE)
    start, end, angle = (
        np.asarray(values)[np.asarray(found.stride)] for values in (found.start, found.end, found.angle)
    )
    assert len(start) == STRIDES
    middles = FIRST + PERIOD * np.arange(STRIDES)
    # The last foot stops softly, its swing has no sharp end.
    np.testing.assert_allclose(0.5 * (start + end)[:-1], middles[:-1], atol=0.02)
    assert 0.1 < end[-1] - middles[-1] < 0.4
    np.testing.assert_allclose(np.diff(end)[:-1], PERIOD, atol=2e-3)
    # The whole lobe is 6 √(2π) 0.09 rad; push-off and landing cut into it.
    np.testing.assert_allclose(angle[:-1], 6.0 * np.sqrt(2.0 * np.pi) * 0.09, rtol=0.15)


def test_a_foot_that_stops_ends_its_swing_in_time():
    last = FIRST + (STRIDES - 1) * PERIOD
    tail = np.where(last + 0.25 < TIME, -0.2, 0.0)  # the shank leans on, slowly: there is no zero crossing at all
    told = [phases(sagittal(TIME) + tail, RATE, d) for d in (shank_events.PAPER, shank_events.MACHINE)]
    assert [int(found.stride.sum()) for found in told] == [STRIDES - 1, STRIDES]
    at = int(np.flatnonzero(told[1].stride)[-1])
    assert 0.1 < float(told[1].end[at]) - last < 0.35
    assert at / RATE < last + 0.6  # and it is known soon


def test_sample_by_sample_as_over_the_recording():
    rate, d = sagittal(TIME)[:600], shank_events.MACHINE
    cascade = butterworth.section(d.cutoff_hz, RATE)
    filtered, state = butterworth.at_rest(cascade, rate[0]), shank_events.begin(rate[0], 0.0)
    step, smooth = jax.jit(shank_events.phase_step), jax.jit(butterworth.step)
    online = []
    for k, sample in enumerate(rate):
        filtered, x = smooth(cascade, filtered, sample)
        state, found = step(d, state, x, k / RATE)
        if found.stride:
            online.append((k, float(found.end), float(found.angle)))
    told = shank_events.phases(rate, RATE)
    at = np.flatnonzero(told.stride)
    late = butterworth.delay(d.cutoff_hz, RATE)
    assert [k for k, _, _ in online] == at.tolist()
    np.testing.assert_allclose([end - late for _, end, _ in online], told.end[at], rtol=1e-12)
    np.testing.assert_allclose([angle for _, _, angle in online], told.angle[at], rtol=1e-10)


def test_slow_swings_need_no_push_off():
    slow = np.where(sagittal(TIME) < 0.0, sagittal(TIME), 0.0) * 0.3  # 1.8 rad/s, and nothing but swings
    assert int(swings(slow, RATE).stride.sum()) == STRIDES
    assert int(phases(slow, RATE).stride.sum()) == 0


def test_standing_still_is_an_empty_table():
    quiet = 0.02 * np.sin(3.0 * TIME)
    for found in (phases(quiet, RATE), swings(quiet, RATE)):
        assert not found.stride.any()
    still = Imu(TIME, np.zeros((SAMPLES, 3)), np.tile([0.0, 0.0, 9.81], (SAMPLES, 1)), np.ones(SAMPLES, bool))
    assert shank_axes.functional_axes(still) is None


@pytest.mark.parametrize("rate_hz", [20.0, 500.0])
def test_other_sampling_rates_are_refused(rate_hz):
    with pytest.raises(ValueError, match="between 25 and 400 Hz"):
        shank_events.phases(sagittal(TIME), rate_hz)


@pytest.mark.parametrize("rate_hz", [25.0, 400.0])
def test_supported_rates_find_the_same_strides(rate_hz):
    time = np.arange(int(10 * rate_hz)) / rate_hz
    for detector in (shank_events.phases, shank_events.swings):
        found = detector(sagittal(time), rate_hz)
        assert int(found.stride.sum()) == STRIDES
        np.testing.assert_allclose(np.diff(found.end[np.flatnonzero(found.stride)])[:-1], PERIOD, atol=0.01)


def test_axes_and_sign_are_computed_from_the_walk():
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn = turn * np.sign(np.linalg.det(turn))
    straight = shank_axes.functional_axes(worn(np.eye(3)))
    np.testing.assert_allclose(straight.rows, np.eye(3), atol=0.02)
    axes = shank_axes.functional_axes(worn(turn))
    np.testing.assert_allclose(axes.rows, straight.rows @ turn, atol=1e-6)
    assert axes.asymmetry < -shank_axes.LEAST_ASYMMETRY


def test_exchanged_labels_are_noticed():
    (walked, _), *_ = simulate.cohort(
        jax.random.key(2), 1, simulate.straight(8.0), placements=("thigh_right", "shank_right"), recorded=False
    )
    assert shank_axes.worn_on_shank(walked, "right") == ("shank_right", None)
    thigh, shank = (walked.sensors[name] for name in ("thigh_right", "shank_right"))
    wrong = walked._replace(sensors={"shank_right": thigh, "thigh_right": shank})
    placement, note = shank_axes.worn_on_shank(wrong, "right")
    assert placement == "thigh_right"
    assert note is not None and note.code == "places_exchanged"
    with pytest.raises(RecordingError, match="shank_left is needed; the recording has thigh_right, shank_right"):
        shank_axes.worn_on_shank(walked, "left")


def test_a_swing_in_which_the_sagittal_rate_is_least_is_no_stance():
    time = np.arange(0.0, 3.0, 1.0 / RATE)
    rate = 0.5 + np.zeros(time.size)  # rolls over the foot
    start, end = (np.rint(RATE * np.array(at)).astype(int) for at in ([0.6, 1.9], [0.9, 2.2]))
    at = [int(RATE * seconds) for seconds in (1.3, 1.6)]
    rate[at] = 0.2, -0.5  # the valley, and a leg that leaves the ground in a tight turn
    speed = np.abs(rate)
    assert shank_stance.stances(rate, speed, start, end, RATE).end[0] == at[1]
    speed[at[1]] = 3.0
    stood = shank_stance.stances(rate, speed, start, end, RATE)
    assert stood.end[0] == stood.begin[1] == at[0]


@pytest.mark.parametrize(("norm", "steps"), [(1.2, False), (2.0, True)])
def test_a_closing_step_before_standing_ends_a_stance_and_a_shank_that_straightens_up_does_not(norm, steps):
    time = np.arange(0.0, 4.0, 1.0 / RATE)
    rate = np.where(time < 1.4, 0.5, 0.0)  # rolls over the foot, then stands
    rate[round(1.1 * RATE)] = 0.3
    moves = slice(round(1.4 * RATE), round(1.6 * RATE))
    rate[moves] = -1.1
    speed = np.abs(rate)
    speed[moves] = norm
    start, end = (np.rint(RATE * np.array(at)).astype(int) for at in ([0.5], [0.9]))
    stood = shank_stance.stances(rate, speed, start, end, RATE)
    assert (stood.end[0] == round(1.1 * RATE), stood.standing[0, 1]) == (steps, not steps)


@pytest.mark.parametrize(("turns", "pauses"), [(0.2, False), (0.02, True)])
def test_a_pause_is_a_long_stance_in_which_the_shank_rests(turns, pauses):
    time = np.arange(0.0, 5.0, 1.0 / RATE)
    rate = turns + 0.1 * np.abs(time - 1.8)  # [rad/s]
    start, end = (np.rint(RATE * np.array(at)).astype(int) for at in ([0.6, 3.2], [1.0, 3.6]))
    stood = shank_stance.stances(rate, np.abs(rate), start, end, RATE)
    assert stood.standing[0, 1] == stood.standing[1, 0] == pauses
    assert (stood.end[0] < stood.begin[1]) == pauses


def test_stances_lie_between_swings_and_in_standing():
    told = swings(sagittal(TIME), RATE)
    start, end = (np.rint(np.asarray(v)[np.asarray(told.stride)] * RATE) for v in (told.start, told.end))
    rate = np.asarray(butterworth.low_pass_both_ways(sagittal(TIME), 4.0, RATE))
    stood = shank_stance.stances(rate, np.abs(rate), start, end, RATE)
    assert stood.standing.sum() == 2
    assert stood.standing[0, 0]
    assert stood.standing[-1, 1]
    np.testing.assert_array_equal(stood.end[:-1], stood.begin[1:])
    middles = RATE * (FIRST + PERIOD * np.arange(STRIDES))
    assert np.all(stood.begin < middles)
    assert np.all(stood.end > middles)
    assert np.all(np.abs(rate[stood.end]) < 0.3)
    with pytest.raises(ValueError, match="before the next"):
        shank_stance.stances(rate, np.abs(rate), end, start, RATE)
