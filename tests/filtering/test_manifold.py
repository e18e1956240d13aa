"""States that are no vectors: attitudes as unit quaternions, and a curved line whose results follow by hand."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering.problems import LINE, Place

from jgait import filtering
from jgait.filtering import CKF, EKF, KF, UKF, Belief, Covariance, IteratedEKF, Model

DT = 0.05
SAMPLES = 60
RUNS = 30
GYRO, BIAS_WALK, DIRECTION = 0.02, 1e-3, 0.05


class Wxyz(NamedTuple):
    """A unit quaternion that takes body vectors to the world."""

    w: Any
    x: Any
    y: Any
    z: Any


class Axis(NamedTuple):
    """Three components in body axes."""

    x: Any
    y: Any
    z: Any


class Attitude(NamedTuple):
    """Orientation, and the gyroscope's bias [rad/s]."""

    q: Wxyz
    bias: Axis


class AttitudeError(NamedTuple):
    """Rotation vector in body axes [rad], and the bias's error."""

    angle: Axis
    bias: Axis


class Directions(NamedTuple):
    """World's up and north, seen from the body."""

    up: Axis
    north: Axis


def times(a: Wxyz, b: Wxyz) -> Wxyz:
    return Wxyz(
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    )


def turned(v: Axis) -> Wxyz:
    """exp of half a rotation vector."""
    square = v.x * v.x + v.y * v.y + v.z * v.z
    small = square < 1e-8
    angle = jnp.sqrt(jnp.where(small, 1.0, square))
    half_sinc = jnp.where(small, 0.5 - square / 48.0, jnp.sin(0.5 * angle) / angle)
    cosine = jnp.where(small, 1.0 - square / 8.0, jnp.cos(0.5 * angle))
    return Wxyz(cosine, half_sinc * v.x, half_sinc * v.y, half_sinc * v.z)


def rotation_vector(q: Wxyz) -> Axis:
    """Twice the log of a unit quaternion, the shorter way round."""
    sign = jnp.where(q.w < 0.0, -1.0, 1.0)
    square = q.x * q.x + q.y * q.y + q.z * q.z
    small = square < 1e-8
    sine = jnp.sqrt(jnp.where(small, 1.0, square))
    scale = sign * jnp.where(small, 2.0 + square / 3.0, 2.0 * jnp.arctan2(sine, sign * q.w) / sine)
    return Axis(scale * q.x, scale * q.y, scale * q.z)


def into_body(q: Wxyz, world: Axis) -> Axis:
    zero = jnp.zeros_like(q.w)
    inverse = Wxyz(q.w, -q.x, -q.y, -q.z)
    seen = times(times(inverse, Wxyz(zero, *(zero + c for c in world))), q)
    return Axis(seen.x, seen.y, seen.z)


def attitude_retract(state: Attitude, error: AttitudeError) -> Attitude:
    return Attitude(times(state.q, turned(error.angle)), jax.tree.map(lambda a, b: a + b, state.bias, error.bias))


def attitude_local(reference: Attitude, state: Attitude) -> AttitudeError:
    q = reference.q
    between = times(Wxyz(q.w, -q.x, -q.y, -q.z), state.q)
    return AttitudeError(rotation_vector(between), jax.tree.map(lambda a, b: b - a, reference.bias, state.bias))


def attitude_initial(p: Any) -> Belief:
    del p
    mean = Attitude(Wxyz(1.0, 0.0, 0.0, 0.0), Axis(0.0, 0.0, 0.0))
    variances = AttitudeError(Axis(0.5**2, 0.5**2, 0.5**2), Axis(0.1**2, 0.1**2, 0.1**2))
    return Belief(mean, Covariance.from_variances(variances))


def attitude_transition(p: Any, s: Attitude, gyr: Axis, dt: Any) -> Attitude:
    del p
    return Attitude(times(s.q, turned(Axis(*((g - b) * dt for g, b in zip(gyr, s.bias, strict=True))))), s.bias)


def attitude_noise(p: Any, s: Attitude, gyr: Axis, dt: Any) -> AttitudeError:
    del p, s, gyr
    angle, walk = GYRO**2 * dt, BIAS_WALK**2 * dt
    return AttitudeError(Axis(angle, angle, angle), Axis(walk, walk, walk))


def attitude_observation(p: Any, s: Attitude, gyr: Axis) -> Directions:
    del p, gyr
    return Directions(into_body(s.q, Axis(0.0, 0.0, 1.0)), into_body(s.q, Axis(1.0, 0.0, 0.0)))


def direction_noise(p: Any, s: Attitude, gyr: Axis) -> Directions:
    del s, gyr
    return Directions(Axis(p, p, p), Axis(p, p, p))


ATTITUDE = Model(
    attitude_initial, attitude_transition, attitude_noise, attitude_observation, direction_noise,
    attitude_retract, attitude_local,
)  # fmt: skip


class Tumble(NamedTuple):
    """Runs (RUNS, SAMPLES) of a tumbling body, its truth drawn from the model's own prior and noise."""

    seen: Directions
    gyr: Axis
    truth: Attitude


@pytest.fixture(scope="module")
def tumble() -> Tumble:
    def three(draws: Any) -> Axis:
        return Axis(draws[0], draws[1], draws[2])

    def one(key: Any) -> Tumble:
        keys = jax.random.split(key, 5)
        start = AttitudeError(
            three(0.5 * jax.random.normal(keys[0], (3,))), three(0.1 * jax.random.normal(keys[1], (3,)))
        )
        first = attitude_retract(jax.tree.map(jnp.asarray, attitude_initial(None).mean), start)
        time = DT * jnp.arange(float(SAMPLES))
        rate = Axis(2.0 * jnp.sin(time), 1.5 * jnp.cos(0.7 * time), 1.0 + jnp.sin(1.3 * time))
        angles = GYRO * DT**0.5 * jax.random.normal(keys[2], (SAMPLES, 3))
        walks = BIAS_WALK * DT**0.5 * jax.random.normal(keys[3], (SAMPLES, 3))

        def move(state: Attitude, now: Any) -> tuple[Attitude, tuple[Attitude, Axis]]:
            w, angle, walk = now
            gyr = jax.tree.map(lambda a, b: a + b, w, state.bias)
            after = attitude_transition(None, state, gyr, DT)
            after = attitude_retract(after, AttitudeError(three(angle), three(walk)))
            return after, (after, gyr)

        truth, gyr = jax.lax.scan(move, first, (rate, angles, walks))[1]
        clean = jax.vmap(lambda s: attitude_observation(None, s, None))(truth)
        noise = DIRECTION * jax.random.normal(keys[4], (6, SAMPLES))
        leaves, structure = jax.tree.flatten(clean)
        return Tumble(jax.tree.unflatten(structure, [a + b for a, b in zip(leaves, noise, strict=True)]), gyr, truth)

    return jax.tree.map(np.asarray, jax.jit(lambda key: jax.vmap(one)(jax.random.split(key, RUNS)))(jax.random.key(1)))


apart = jax.jit(jax.vmap(jax.vmap(attitude_local)))


def error_of(mean: Attitude, truth: Attitude) -> np.ndarray:
    return np.stack(jax.tree.leaves(apart(mean, truth)), -1)


def nees(error: np.ndarray, cov: Covariance) -> np.ndarray:
    return np.einsum("...i,...ij,...j->...", error, np.linalg.inv(np.asarray(cov.dense())), error)


def test_the_charts_of_these_tests_are_inverse_to_each_other(tumble):
    there = jax.tree.map(lambda v: v[:, 0], tumble.truth)
    back = jax.tree.map(lambda v: v[:, 7], tumble.truth)
    again = jax.jit(jax.vmap(lambda a, b: attitude_retract(a, attitude_local(a, b))))(there, back)
    sign = np.sign(np.sum(np.stack(again.q) * np.stack(back.q), 0))
    np.testing.assert_allclose(np.stack(again.q) * sign, np.stack(back.q), atol=1e-12)


@pytest.mark.parametrize("method", [EKF(), IteratedEKF(3), UKF()], ids=str)
def test_attitude_is_estimated_and_its_covariance_is_that_of_the_error(tumble, method):
    solve = jax.vmap(
        lambda seen, gyr: filtering.kalman_smoother(
            ATTITUDE, DIRECTION**2, seen, controls=gyr, dt=DT, method=method, keep=("mean", "cov", "nis")
        )
    )
    out = jax.jit(solve)(tumble.seen, tumble.gyr)
    assert out.cov.names == ("angle.x", "angle.y", "angle.z", "bias.x", "bias.y", "bias.z")
    np.testing.assert_allclose(np.sum(np.stack(out.mean.q) ** 2, 0), 1.0, atol=1e-12)
    filtered = error_of(out.filtered.mean, tumble.truth)
    smoothed = error_of(out.mean, tumble.truth)
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
    seen, gyr = jax.tree.map(lambda v: v[0], (tumble.seen, tumble.gyr))
    with pytest.raises(ValueError, match="KF needs a linear model"):
        filtering.kalman_filter(ATTITUDE, 1e-2, seen, controls=gyr, dt=DT, method=KF())


class Rotation(NamedTuple):
    """An error of an orientation alone [rad]."""

    angle: Axis


def orientation_initial(p: Any) -> Belief:
    del p
    return Belief(Wxyz(1.0, 0.0, 0.0, 0.0), Covariance.from_variances(Rotation(Axis(0.25, 0.25, 0.25))))


def orientation_transition(p: Any, q: Wxyz, gyr: Axis, dt: Any) -> Wxyz:
    del p
    return times(q, turned(Axis(*(rate * dt for rate in gyr))))


def orientation_noise(p: Any, q: Wxyz, gyr: Axis, dt: Any) -> Rotation:
    del p, q, gyr
    return Rotation(Axis(*(GYRO**2 * dt,) * 3))


def upward(p: Any, q: Wxyz, gyr: Axis) -> Axis:
    del p, gyr
    return into_body(q, Axis(0.0, 0.0, 1.0))


def upward_noise(p: Any, q: Wxyz, gyr: Axis) -> Axis:
    del q, gyr
    return Axis(p, p, p)


ORIENTATION = Model(
    orientation_initial, orientation_transition, orientation_noise, upward, upward_noise,
    lambda q, error: times(q, turned(error.angle)),
    lambda a, b: Rotation(rotation_vector(times(Wxyz(a.w, -a.x, -a.y, -a.z), b))),
)  # fmt: skip
"""A gyroscope without bias, and the world's up."""


def test_gradients_through_a_rotation(tumble):
    up, gyr = jax.tree.map(lambda v: v[0, :10], (tumble.seen.up, tumble.gyr))

    def value(p: Any) -> Any:
        out = filtering.kalman_smoother(ORIENTATION, p, up, controls=gyr, dt=DT, covariance=False)
        told = out.filtered
        return jnp.sum(out.mean.x) + jnp.sum(told.cov["angle.x", "angle.y"]) + jnp.sum(told.log_likelihood)

    program = jax.jit(jax.value_and_grad(value))
    at = 0.01
    differences = (float(program(at + 1e-6)[0]) - float(program(at - 1e-6)[0])) / 2e-6
    assert float(program(at)[1]) == pytest.approx(differences, rel=1e-5)


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


class Size(NamedTuple):
    """A positive size."""

    size: Any


class Ratio(NamedTuple):
    """Logarithm of a ratio of sizes, or of a reading."""

    log: Any


def size_initial(p: Any, *, logs: bool) -> Belief:
    mean = jnp.asarray(0.3)
    return Belief(Ratio(mean) if logs else Size(jnp.exp(mean)), Covariance.from_variances(Ratio(p)))


def size_decay(p: Any, s: Any, u: Any, dt: Any, *, logs: bool) -> Any:
    del p, u
    return Ratio(s.log * (1.0 - 0.2 * dt)) if logs else Size(s.size ** (1.0 - 0.2 * dt))


def size_noise(p: Any, s: Any, u: Any, dt: Any) -> Ratio:
    del s, u
    return Ratio(p * dt)


def size_seen(p: Any, s: Any, u: Any, *, logs: bool) -> Ratio:
    del p, u
    return Ratio(2.0 * s.log if logs else 2.0 * jnp.log(s.size))


def size_reading(p: Any, s: Any, u: Any) -> Ratio:
    del p, s, u
    return Ratio(0.4)


def size_retract(state: Size, error: Ratio) -> Size:
    return Size(state.size * jnp.exp(error.log))


def size_local(reference: Size, state: Size) -> Ratio:
    return Ratio(jnp.log(state.size / reference.size))


def sized(*, logs: bool) -> Model:
    """The same model with the size or its logarithm as the state."""
    functions = [partial(f, logs=logs) for f in (size_initial, size_decay, size_seen)]
    charts = (None, None) if logs else (size_retract, size_local)
    return Model(functions[0], functions[1], size_noise, functions[2], size_reading, *charts)


@pytest.mark.parametrize("method", [EKF(), IteratedEKF(3), UKF(), CKF(iterations=2)], ids=str)
def test_a_flat_chart_gives_the_linear_result(method):
    seen = Ratio(jnp.asarray(np.random.default_rng(2).normal(size=12)))
    plain, charted = (
        filtering.kalman_smoother(sized(logs=logs), 0.3, seen, dt=0.3, method=method) for logs in (True, False)
    )
    np.testing.assert_allclose(jnp.log(charted.mean.size), plain.mean.log, rtol=0, atol=1e-10)
    np.testing.assert_allclose(charted.cov["log", "log"], plain.cov["log", "log"], rtol=0, atol=1e-10)
    np.testing.assert_allclose(charted.filtered.log_likelihood, plain.filtered.log_likelihood, rtol=0, atol=1e-10)
