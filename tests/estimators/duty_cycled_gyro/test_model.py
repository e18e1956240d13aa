"""The thigh's and the shin's filter under a gyroscope mask: mechanics, laws, strapdown."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import strapdown
from made.observability import observability_matrix, observability_rank

from experiments.common import protocols
from jgait import simulate
from jgait.duty_cycle import power
from jgait.estimators import leg_ekf
from jgait.estimators.duty_cycled_gyro import model as duty_model
from jgait.estimators.duty_cycled_gyro.model_params import (
    DutyControl,
    DutyInputs,
    LinkParams,
    PlanarSegment,
    ShinObservation,
    ShinState,
    ThighObservation,
    ThighState,
)
from jgait.estimators.duty_cycled_gyro.params import DutyCycledParams
from jgait.geometry.vectors import GRAVITY
from jgait.simulate.sensors import IDEAL

RATE = 50.0
T = 1.0 / RATE
LINK = LinkParams(0.4, 0.2, 2.0, 3.0, 0.1, 1e-4, 1e-4)
CONTROL = DutyControl(1.0, 1.0, 1.0)
RUN = jax.jit(duty_model.run)
BOTH = (
    (duty_model.THIGH, ThighState(0.2, 0.1, 0.3, 0.05, 0.4, 2.0, 0.01, 0.3, 2.0)),
    (duty_model.SHIN, ShinState(ThighState(0.6, 0.1, 0.3, 0.05, 0.4, 2.0, 0.01, -0.3, 2.0), 0.2, 1.0)),
)


@pytest.fixture(scope="module")
def walk():
    """Five seconds of walking with ideal sensors: prepared signals, and the parameters of the person."""
    # As in tests/test_protocols.py, so that the simulator is compiled once for both.
    walked, _ = protocols.udaya_shankar(jax.random.key(0), 2, 5.0, placements=simulate.FOUR, errors=IDEAL)
    found = walked.truth.estimate.diagnostics
    thigh, shank = float(found["thigh_length"]), float(found["shank_length"])
    p = DutyCycledParams(thigh_length=thigh, shank_length=shank)
    return leg_ekf.prepared(walked.recording).inputs, p


def planar(segment, gyro_on=None):
    """The signals of a segment in the sagittal plane."""
    samples = segment.gyr.shape[0]
    return PlanarSegment(
        -segment.gyr[:, 1], segment.acc[:, 0], segment.acc[:, 2], segment.measured,
        np.ones(samples, bool) if gyro_on is None else gyro_on, np.zeros(samples), -segment.bias[1], segment.variance,
    )  # fmt: skip


def inputs_of(prepared, gyro_on=None) -> DutyInputs:
    leg = prepared.right
    made = DutyInputs(
        planar(leg.thigh), planar(leg.shank, gyro_on), prepared.time, prepared.dt, prepared.still, prepared.valid,
        prepared.start_variance,
    )  # fmt: skip
    return jax.tree.map(jnp.asarray, made)


@pytest.fixture(scope="module")
def integrated(walk):
    """Angles of thigh and shank by strapdown integration in space."""
    leg = walk[0].right

    def angle(segment):
        rate = segment.gyr - segment.bias
        turned = strapdown.attitude(jnp.asarray(rate), T, jnp.eye(3))
        return np.arctan2(-turned[:, 0, 2], turned[:, 2, 2])

    return angle(leg.thigh), angle(leg.shank)


def rms_deg(values) -> float:
    return float(np.degrees(np.sqrt(np.mean(np.square(values)))))


def test_angles_are_those_of_strapdown_on_a_clean_signal(walk, integrated):
    prepared, p = walk
    found = RUN(p, inputs_of(prepared))
    for segment, truth in zip(found, integrated, strict=True):
        assert rms_deg(segment.angle - truth) < 1.0
        assert np.degrees(np.max(np.abs(segment.angle - truth))) < 2.0
        assert bool(jnp.all(segment.valid))
    rate = prepared.right.shank.bias[1] - prepared.right.shank.gyr[:, 1]
    assert np.sqrt(np.mean((found.shank.rate - rate) ** 2)) < 0.01 * np.sqrt(np.mean(rate**2))


def seen(model, *hidden):
    shown = ThighObservation(*(name not in hidden for name in ThighObservation._fields))
    return ShinObservation(shown, True, True) if model is duty_model.SHIN else shown


@pytest.mark.parametrize("number", [0, 1])
def test_every_state_is_observable_and_only_the_bias_is_lost_with_the_gyroscope(number):
    model, moving = BOTH[number]
    whole = len(jax.tree.leaves(moving))
    for state in (model.initial(LINK).mean, moving):

        def rank(*hidden, state=state):
            return observability_rank(model, LINK, state, CONTROL, T, seen(model, *hidden))

        assert rank("swing", "rest_down", "rest_forward") == whole
        assert rank("gyro", "rest_down", "rest_forward") == whole - 1
        bias = np.zeros(whole)
        bias[ThighState._fields.index("velocity_bias")] = 1.0
        rows = observability_matrix(model, LINK, state, CONTROL, T, seen(model, "gyro"))
        np.testing.assert_allclose(rows @ bias, 0.0, atol=1e-12)


def test_the_observation_is_that_of_a_swinging_link():
    """Position, velocity and specific force of both sensors from the angles by autodiff alone."""

    def thigh(t):
        return 0.4 * jnp.sin(3.0 * t) + 0.1

    def shank(t):
        return 0.6 * jnp.cos(4.0 * t) - 0.2

    def place(angle, length):
        return lambda t: length * jnp.stack([jnp.cos(angle(t)), jnp.sin(angle(t))])

    def sensor(t):
        return place(thigh, LINK.thigh_length)(t) + place(shank, LINK.lever)(t)

    t = 0.37
    for where, angle, model in ((place(thigh, LINK.lever), thigh, duty_model.THIGH), (sensor, shank, duty_model.SHIN)):
        (x, z), (vx, vz) = where(t), jax.jacfwd(where)(t)
        ax, az = jax.jacfwd(jax.jacfwd(where))(t)
        own = ThighState(x, vx, ax, z, vz, az, 0.02, angle(t), jax.grad(angle)(t))
        state = own
        if model is duty_model.SHIN:
            state = ShinState(own, thigh(t), jax.grad(thigh)(t))
        read = model.observation(LINK, state, CONTROL)
        read = read.shin if model is duty_model.SHIN else read
        up = -jnp.stack([jnp.cos(angle(t)), jnp.sin(angle(t))])
        forward = jnp.stack([-jnp.sin(angle(t)), jnp.cos(angle(t))])
        force = jnp.stack([ax - GRAVITY, az])
        np.testing.assert_allclose((read.acc_up, read.acc_forward), (force @ up, force @ forward), atol=1e-12)
        np.testing.assert_allclose(read[3:7], 0.0, atol=1e-12)
        assert float(read.gyro) == pytest.approx(float(own.rate) - 0.02 / LINK.lever)


@pytest.fixture(scope="module")
def gaps(walk):
    """Half of the time without the shin's gyroscope."""
    prepared, p = walk
    on = power.masks(power.schedule_of_duty(0.5), prepared.time.size, RATE).usable
    return on, inputs_of(prepared, on), RUN(p, inputs_of(prepared, on))


def test_a_gap_widens_the_belief_and_the_truth_stays_in_it(walk, integrated, gaps):
    prepared, _ = walk
    on, _, found = gaps
    off = ~on & ~prepared.still
    error = found.shank.angle - integrated[1]
    rate = prepared.right.shank.bias[1] - prepared.right.shank.gyr[:, 1]
    # Errors of a few strides, and far from Gaussian: a factor of two is what they can tell.
    assert 0.3 < np.sqrt(np.mean((error[off] / found.shank.angle_stddev[off]) ** 2)) < 2.0
    assert 0.3 < np.sqrt(np.mean(((found.shank.rate - rate)[off] / found.shank.rate_stddev[off]) ** 2)) < 2.0
    assert np.max(np.abs(found.shank.angle)) < np.pi / 2
    # Better than to say that the shank does not turn.
    assert np.sqrt(np.mean((found.shank.rate - rate)[off] ** 2)) < 0.8 * np.sqrt(np.mean(rate[off] ** 2))
    walking = ~prepared.still
    assert float(jnp.mean(found.shank.rate_stddev[off])) > 10.0 * float(jnp.mean(found.shank.rate_stddev[walking & on]))
