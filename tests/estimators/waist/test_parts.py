"""The parts of the waist's estimator on problems whose answer is known, from attitude to bouts and integration."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait import filtering
from jgait.estimators.waist import WaistParams, with_body
from jgait.estimators.waist import model as waist_model
from jgait.estimators.waist import orientation as waist_orientation
from jgait.estimators.waist import steps as waist_steps
from jgait.estimators.waist.bouts import CLOSING, bouts
from jgait.estimators.waist.inputs import WaistInputs
from jgait.estimators.waist.model import WaistControl, WaistModelParams, WaistObservation
from jgait.estimators.waist.orientation import TrunkControl, TrunkError, TrunkNoise, TrunkObservation
from jgait.estimators.waist.readout import constant_variance, personal_constant
from jgait.estimators.waist.steps import Intervals
from jgait.events.trunk import Contacts
from jgait.geometry.vectors import GRAVITY

ROWS, STEP_S = 12, 0.5
MODEL = WaistModelParams(
    speed_density=1e4, bias_variance=1e-8, bias_density=0.0, turn_variance=0.0, start_speed=0.7,
    start_speed_variance=100.0, standing_variance=1e-8, constant=1.3,
)  # fmt: skip
LENGTHS = 0.5 + 0.02 * np.arange(ROWS)


@pytest.fixture(scope="module")
def walked():
    """`walked(params, controls, durations, mask)`: the smoothed state of a walk of some rows, compiled once."""
    zero = np.zeros(ROWS)

    @jax.jit
    def told(p, controls, dt, mask):
        return filtering.kalman_smoother(
            waist_model.MODEL, p, WaistObservation(zero, zero), controls=controls, dt=dt, mask=mask,
            initial=waist_model.initial(p),
        )  # fmt: skip

    return told


def control(**fields):
    zero = np.zeros(ROWS)
    plain = WaistControl(zero, zero, zero, zero, zero, zero + 1e-8)
    return plain._replace(**fields)


def there(**fields):
    no = np.zeros(ROWS, bool)
    return WaistObservation(no, no)._replace(**fields)


def test_of_the_pendulum_alone_the_way_is_the_sum_of_its_steps(walked):
    walks = np.r_[0.0, np.ones(ROWS - 4), 0.0, 0.0, 0.0]  # a node from which, eight steps, and padding
    dt = STEP_S * walks
    steps = walks > 0.0
    told = walked(MODEL, control(walks=walks, pendulum=LENGTHS / 1.3), dt, there(pendulum=steps))
    expected = np.where(steps, LENGTHS, 0.0)
    np.testing.assert_allclose(told.mean.step, expected, atol=1e-4)
    np.testing.assert_allclose(told.mean.distance, np.cumsum(expected), atol=1e-3)
    np.testing.assert_allclose(told.mean.stride[2:9], expected[2:9] + expected[1:8], atol=1e-4)
    # padding carries the way and its deviation on, but for the ten micrometres that keep a covariance its rank
    last = np.flatnonzero(steps)[-1]
    sd = np.asarray(told.cov.stddev().distance)
    np.testing.assert_allclose(sd[last + 1 :], sd[last], rtol=5e-3)
    np.testing.assert_allclose(told.mean.speed[last + 1 :], MODEL.start_speed, atol=1e-6)


def test_standing_before_and_after_gives_the_bias_of_the_accelerometer(walked):
    """Speed is a triangle; the accelerometer reads 0.05 m/s² too much, and there is no pendulum."""
    bias, count = 0.05, ROWS - 1
    speed = np.minimum(np.arange(ROWS), count - np.arange(ROWS)) * 0.3
    gained = np.diff(speed, prepend=0.0)
    went = np.r_[0.0, 0.5 * STEP_S * gained[1:]]
    walks = np.r_[0.0, np.ones(count)]
    dt = STEP_S * walks
    p = MODEL._replace(speed_density=1e-8, bias_variance=0.01)
    read = control(walks=walks, gained=gained + bias * dt, went=went + 0.5 * bias * dt**2)
    told = walked(p, read, dt, there(speed=np.r_[True, np.zeros(count - 1, bool), True]))
    np.testing.assert_allclose(told.mean.bias, bias, atol=1e-3)
    np.testing.assert_allclose(told.mean.speed, speed, atol=5e-3)
    way = np.r_[0.0, np.cumsum(0.5 * STEP_S * (speed[1:] + speed[:-1]))]
    np.testing.assert_allclose(told.mean.distance, way, atol=0.02)


SAMPLES, RATE = 600, 50.0
TIME = np.arange(SAMPLES) / RATE


@pytest.fixture(scope="module")
def trunk():
    """`trunk(gyr, acc, acc_bias)`: the filtered state of a trunk that began upright; compiled once."""

    @jax.jit
    def told(gyr, acc, acc_bias):
        even = np.full(SAMPLES, 1.0)
        controls = TrunkControl(gyr, acc, 1e-8 * even, 1e-2 * even)
        start = waist_orientation.belief(np.eye(4)[0], np.zeros(3), TrunkError(0.1, 1e-12, acc_bias**2))
        return filtering.kalman_filter(
            waist_orientation.MODEL, TrunkNoise(0.0, 0.0), TrunkObservation(np.zeros((SAMPLES, 3))),
            controls=controls, dt=np.r_[0.0, np.full(SAMPLES - 1, 1.0 / RATE)], initial=start,
        ).mean  # fmt: skip

    return told


def test_a_turn_parts_the_accelerometers_bias_from_a_lean(trunk):
    bias = np.array([0.3, -0.1, 0.0])
    acc = np.tile([0.0, 0.0, GRAVITY], (SAMPLES, 1)) + bias
    turning = np.zeros((SAMPLES, 3))
    turning[:, 2] = np.pi / TIME[-1]
    ahead, round_ = (trunk(gyr, acc, 0.3).acc_bias for gyr in (np.zeros((SAMPLES, 3)), turning))
    np.testing.assert_allclose(round_[-1, :2], bias[:2], atol=0.03)
    assert abs(ahead[-1, 0]) < 0.5 * bias[0]


def test_the_pendulum_of_zijlstra_and_hof():
    p = WaistParams(excursion_power=1.0, surge_power=0.0, pendulum_length=0.9)
    h = np.array([0.01, 0.03, 0.05])
    np.testing.assert_allclose(
        waist_steps.pendulum(p, h, np.full(3, 0.3)), 2.0 * np.sqrt(2.0 * 0.9 * h - h * h), rtol=1e-12
    )
    # who does not rise takes no step, and no derivative is infinite there
    slope = jax.grad(lambda x: waist_steps.pendulum(p, x, jnp.asarray(0.3)))(0.0)
    assert waist_steps.pendulum(p, 0.0, 0.3) == 0.0 and float(slope) == 0.0
    # both powers, by hand
    both = WaistParams(excursion_power=0.8, surge_power=0.1, pendulum_length=0.9)
    chord, quick = 2.0 * np.sqrt(2.0 * 0.03 / 0.9 - (0.03 / 0.9) ** 2), 0.3 / np.sqrt(GRAVITY * 0.9)
    expected = 0.9 * chord**0.8 * quick**0.1
    np.testing.assert_allclose(waist_steps.pendulum(both, 0.03, 0.3), expected, rtol=1e-12)


HZ, STEP = 100.0, 0.5


def bout_of(steps, stands_s, forward=None):
    """The nodes of one bout whose contacts are at these steps after 2 s, right and left in turn, before standing."""
    time = 2.0 + STEP * np.asarray(steps, float)
    side, every = np.arange(time.size) % 2, np.ones(time.size)
    contacts = Contacts(time, side, every > 0.0, time, every / STEP, 0.9 * every)
    still = [(0, 100), (round(stands_s * HZ), round(stands_s * HZ) + 200)]
    (bout,) = bouts(contacts, still, HZ, np.zeros(1000) if forward is None else forward)
    return bout


def test_a_closing_step_without_a_jolt_comes_between_the_last_contact_and_standing():
    bout = bout_of([0, 1, 2, 3], 4.7)  # 2.4 steps after the last contact
    assert sum(node.contact for node in bout) == 5
    assert bout[-2].at == pytest.approx(HZ * (2.0 + (3.0 + CLOSING) * STEP))
    assert (bout[-2].side, bout[-2].step, bout[-2].stands, bout[-1].stands) == (0, True, False, True)
    # who stands still sooner has closed the step before
    assert sum(node.contact for node in bout_of([0, 1, 2, 3], 4.4)) == 4


def test_an_unknown_height_is_a_wider_deviation():
    unknown, person, sensor = (
        constant_variance(with_body(WaistParams(), body)) for body in ({}, {"height": 1.6}, {"sensor_height": 0.96})
    )
    assert unknown > person > sensor > WaistParams().pendulum_constant_sd ** 2


def constant_of(lengths, p, **fields):
    """K and its variance after starts from standing, each with the length [m] of two steps whose pendulum's is 1 m."""
    many, of_one = len(lengths), 8
    rows, first = many * of_one, np.arange(many * of_one) % of_one
    row = {name: np.zeros(rows, bool) for name in ("stands", "fresh", "moves", "steps")}
    at = np.minimum(np.arange(rows), 99)
    inputs = WaistInputs(**dict.fromkeys(WaistInputs._fields, None) | row | {
        "at": at, "count": rows, "measured": np.ones(100, bool), "dt": np.full(100, 0.01),
        "stands": first == 0, "fresh": first == 0, "moves": first > 0, "steps": first > 1,
    })  # fmt: skip
    speed = np.repeat(np.asarray(lengths) / 1.0, of_one)
    intervals = Intervals(*(np.where(first > 0, value, 0.0) for value in (STEP_S, 0.0, 0.0, 0.5, 0.0)))
    intervals = intervals._replace(gained=np.where(first == 1, speed, 0.0))
    return personal_constant(p, inputs._replace(**{k: f(getattr(inputs, k)) for k, f in fields.items()}), intervals)


def test_a_start_from_standing_moves_the_constant_toward_its_own_and_narrows_it():
    p = WaistParams()
    prior, usual = constant_variance(p), p.start_gain * p.pendulum_constant
    same, narrow = constant_of([usual], p)
    assert same == pytest.approx(p.pendulum_constant) and narrow < prior
    more, spread = constant_of([1.1 * usual], p)
    assert spread == pytest.approx(narrow)
    assert more == pytest.approx(p.pendulum_constant * 1.1 ** (1.0 - narrow / prior))
    assert constant_of([1.1 * usual] * 3, p)[0] > more > p.pendulum_constant
    assert constant_of([1.1 * usual], p._replace(start_noise=1e-6))[0] == pytest.approx(1.1 * p.pendulum_constant)


@pytest.mark.parametrize("why", ["belt", "no standing", "lost"])
def test_a_start_that_tells_nothing_leaves_the_constant_of_all_people(why):
    p = WaistParams()
    length = 0.1 if why == "belt" else 1.3
    changed = {"no standing": {"stands": np.zeros_like}, "lost": {"measured": np.zeros_like}}.get(why, {})
    constant, variance = constant_of([length], p, **changed)
    assert (constant, variance) == (pytest.approx(p.pendulum_constant), pytest.approx(constant_variance(p)))
