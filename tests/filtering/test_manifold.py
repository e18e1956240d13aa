"""States that are no vectors: attitudes as unit quaternions, and a curved line whose results follow by hand."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering.problems import LINE, Place

from jgait import filtering
from jgait.filtering import KF, Belief, Covariance, Model, draw
from jgait.geometry.rotation import Quaternion, conjugate, exponential, logarithm, product, rotated
from jgait.geometry.vectors import Vector

DT = 0.05
SAMPLES = 60
RUNS = 30
GYRO, BIAS_WALK, DIRECTION = 0.02, 1e-3, 0.05


class Attitude(NamedTuple):
    """Orientation, and the gyroscope's bias [rad/s]."""

    q: Quaternion
    bias: Vector


class AttitudeError(NamedTuple):
    """Rotation vector in body axes [rad], and the bias's error."""

    angle: Vector
    bias: Vector


class Directions(NamedTuple):
    """World's up and north, seen from the body."""

    up: Vector
    north: Vector


def attitude_retract(state: Attitude, error: AttitudeError) -> Attitude:
    return Attitude(
        product(state.q, exponential(error.angle)), jax.tree.map(lambda a, b: a + b, state.bias, error.bias)
    )


def attitude_local(reference: Attitude, state: Attitude) -> AttitudeError:
    between = product(conjugate(reference.q), state.q)
    return AttitudeError(logarithm(between), jax.tree.map(lambda a, b: b - a, reference.bias, state.bias))


def attitude_initial(p: Any) -> Belief:
    mean = Attitude(Quaternion(1.0, 0.0, 0.0, 0.0), Vector(0.0, 0.0, 0.0))
    variances = AttitudeError(Vector(0.5**2, 0.5**2, 0.5**2), Vector(0.1**2, 0.1**2, 0.1**2))
    return Belief(mean, Covariance.from_variances(variances))


def attitude_transition(p: Any, s: Attitude, gyr: Vector, dt: Any) -> Attitude:
    return Attitude(
        product(s.q, exponential(Vector(*((g - b) * dt for g, b in zip(gyr, s.bias, strict=True))))), s.bias
    )


def attitude_noise(p: Any, s: Attitude, gyr: Vector, dt: Any) -> AttitudeError:
    angle, walk = GYRO**2 * dt, BIAS_WALK**2 * dt
    return AttitudeError(Vector(angle, angle, angle), Vector(walk, walk, walk))


def attitude_observation(p: Any, s: Attitude, gyr: Vector) -> Directions:
    return Directions(rotated(conjugate(s.q), Vector(0.0, 0.0, 1.0)), rotated(conjugate(s.q), Vector(1.0, 0.0, 0.0)))


def direction_noise(p: Any, s: Attitude, gyr: Vector) -> Directions:
    return Directions(Vector(p, p, p), Vector(p, p, p))


ATTITUDE = Model(
    attitude_initial, attitude_transition, attitude_noise, attitude_observation, direction_noise,
    attitude_retract, attitude_local,
)  # fmt: skip


@pytest.fixture(scope="module")
def tumble() -> tuple[Attitude, Directions, Vector]:
    """Runs (RUNS, SAMPLES) of a tumbling body: its truth, drawn from the model, what is seen, and the gyroscope."""
    time = DT * jnp.arange(float(SAMPLES))
    gyr = Vector(2.0 * jnp.sin(time), 1.5 * jnp.cos(0.7 * time), 1.0 + jnp.sin(1.3 * time))
    keys = jax.random.split(jax.random.key(1), RUNS)
    drawn = jax.jit(jax.vmap(lambda k: draw(k, ATTITUDE, jnp.asarray(DIRECTION**2), SAMPLES, controls=gyr, dt=DT)))(
        keys
    )
    return jax.tree.map(np.asarray, (*drawn, gyr))


apart = jax.jit(jax.vmap(jax.vmap(attitude_local)))


def error_of(mean: Attitude, truth: Attitude) -> np.ndarray:
    return np.stack(jax.tree.leaves(apart(mean, truth)), -1)


def nees(error: np.ndarray, cov: Covariance) -> np.ndarray:
    return np.einsum("...i,...ij,...j->...", error, np.linalg.inv(np.asarray(cov.dense())), error)


def test_attitude_is_estimated_and_its_covariance_is_that_of_the_error(tumble):
    truth, seen, gyr = tumble
    solve = jax.vmap(
        lambda seen: filtering.kalman_smoother(
            ATTITUDE, DIRECTION**2, seen, controls=gyr, dt=DT, keep=("mean", "cov", "nis")
        )
    )
    out = jax.jit(solve)(seen)
    assert out.cov.names == ("angle.x", "angle.y", "angle.z", "bias.x", "bias.y", "bias.z")
    np.testing.assert_allclose(np.sum(np.stack(out.mean.q) ** 2, 0), 1.0, atol=1e-12)
    filtered = error_of(out.filtered.mean, truth)
    smoothed = error_of(out.mean, truth)
    assert np.degrees(np.abs(filtered[:, 20:, :3])).max() < 5.0
    assert np.sqrt(np.mean(smoothed**2)) < 0.7 * np.sqrt(np.mean(filtered**2))
    late = slice(20, None, 20)  # Far enough apart for the runs' errors to be nearly independent.
    for error, cov in ((filtered, out.filtered.cov), (smoothed, out.cov)):
        ratio = nees(error, cov)[:, late]
        assert abs(ratio.mean() - 6.0) < 6.0 * np.sqrt(12.0 / ratio.size)
    share = np.asarray(out.filtered.nis)[:, late]
    assert abs(share.mean() - 6.0) < 6.0 * np.sqrt(12.0 / share.size)
    dense = np.asarray(out.cov.dense())
    np.testing.assert_array_equal(dense, np.swapaxes(dense, -1, -2))
    assert np.linalg.eigvalsh(dense).min() > 0.0


def test_the_kf_refuses_a_rotation(tumble):
    _, seen, gyr = tumble
    seen = jax.tree.map(lambda v: v[0], seen)
    with pytest.raises(ValueError, match="KF needs a linear model"):
        filtering.kalman_filter(ATTITUDE, 1e-2, seen, controls=gyr, dt=DT, method=KF())


def test_update_and_smoother_on_a_curved_line_are_as_by_hand():
    p, y = 3.0, np.array([2.0, -1.0])
    out = filtering.kalman_smoother(LINE, p, Place(jnp.asarray(y)), dt=jnp.array([0.0, 1.0]))
    # Update: K = P/(P+1); P is then turned to the new origin by d asinh(sinh e − sinh δ)/de = cosh δ at e = δ.
    d0 = p / (p + 1.0) * y[0]
    s0, p0 = np.sinh(d0), np.cosh(d0) ** 2 * p / (p + 1.0)
    p1 = p0 + 0.5
    d1 = p1 / (p1 + 1.0) * (y[1] - s0)
    s1, f1 = s0 + np.sinh(d1), np.cosh(d1) ** 2 * p1 / (p1 + 1.0)
    np.testing.assert_allclose(out.filtered.mean.s, [s0, s1], rtol=1e-12)
    np.testing.assert_allclose(out.filtered.cov["e", "e"], [p0, f1], rtol=1e-12)
    # Smoother: λ = −e/S and Λ = 1/S of the second sample, for errors about the first filtered place.
    d = p0 / (p1 + 1.0) * (y[1] - s0)
    p_s = np.cosh(d) ** 2 * (p0 - p0**2 / (p1 + 1.0))
    np.testing.assert_allclose(out.mean.s, [s0 + np.sinh(d), s1], rtol=1e-12)
    np.testing.assert_allclose(out.cov["e", "e"], [p_s, f1], rtol=1e-12)


def test_gradients_through_a_chart_stay_in_single_precision():
    seen = Place(jnp.asarray([2.0, -1.0], jnp.float32))

    def value(p: Any) -> Any:
        out = filtering.kalman_smoother(LINE, p, seen, dt=jnp.asarray(1.0, jnp.float32))
        return jnp.sum(out.mean.s) + jnp.sum(out.cov["e", "e"]) + jnp.sum(out.filtered.log_likelihood)

    gradient = jax.jit(jax.grad(value))(jnp.asarray(3.0, jnp.float32))
    assert gradient.dtype == jnp.float32 and bool(jnp.isfinite(gradient))
