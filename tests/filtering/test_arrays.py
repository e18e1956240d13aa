"""States of arrays, and of an attitude of jaxlie, against the same model in scalars and quaternions."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxlie import SO3

from jgait import filtering
from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.rotation import Quaternion, conjugate, exponential, logarithm, product, rotated
from jgait.geometry.vectors import Vector, add, scale, subtract

SAMPLES, RUNS, DT = 20, 2, 0.1

# jaxlie multiplies floats by arrays of whole numbers, which the tests' promotion of types refuses.
usual_promotion = jax.numpy_dtype_promotion("standard")


class Noise(NamedTuple):
    """Parameters of both models."""

    turn: Any
    push: Any
    fix: Any


class Body(NamedTuple):
    """A rigid body; its attitude takes vectors of the body to the world."""

    position: Any
    velocity: Any
    attitude: Any
    gain: Any  # of the accelerometer, a scalar


class BodyError(NamedTuple):
    """The same with the rotation vector of the attitude's error, in body axes."""

    position: Any
    velocity: Any
    angle: Any
    gain: Any


class Motion(NamedTuple):
    """What drives it: angular rate and acceleration in body axes."""

    rate: Any
    force: Any


class Fix(NamedTuple):
    """Where it is, how fast it rises, and the world's x axis seen from the body."""

    place: Any
    rise: Any
    ahead: Any


def transition_noise(p: Noise, s: Body, u: Motion, dt: Any) -> Covariance:
    variances = BodyError(p.push * dt**3 / 3.0, p.push * dt, p.turn * dt, 1e-4 * dt)
    if isinstance(s.position, Vector):
        variances = BodyError(*(Vector(v, v, v) for v in variances[:3]), variances.gain)
        mixed = {(f"position.{axis}", f"velocity.{axis}"): p.push * dt**2 / 2.0 for axis in "xyz"}
    else:
        variances = BodyError(*(jnp.full(3, v) for v in variances[:3]), variances.gain)
        mixed = {("position", "velocity"): p.push * dt**2 / 2.0}
    return Covariance.from_variances(variances).with_entries(mixed)


# --- in arrays ---


@usual_promotion
def turned(q: SO3, angle: Any) -> SO3:
    return q @ SO3.exp(angle)


@usual_promotion
def in_world(q: SO3, vector: Any) -> Any:
    return q @ vector


@usual_promotion
def in_body(q: SO3, vector: Any) -> Any:
    return q.inverse() @ vector


@usual_promotion
def angle_between(a: SO3, b: SO3) -> Any:
    return (a.inverse() @ b).log()


def arrays_initial(p: Noise) -> Belief:
    mean = Body(jnp.array([0.0, 0.1, 0.2]), jnp.array([1.0, 0.0, 0.0]), SO3(jnp.array([1.0, 0.0, 0.0, 0.0])), 1.0)
    return Belief(mean, Covariance.from_variances(BodyError(jnp.full(3, 0.04), jnp.full(3, 0.25), jnp.ones(3), 0.01)))


def arrays_transition(p: Noise, s: Body, u: Motion, dt: Any) -> Body:
    pushed = in_world(s.attitude, u.force * s.gain)
    return Body(s.position + dt * s.velocity, s.velocity + dt * pushed, turned(s.attitude, u.rate * dt), s.gain)


def arrays_observation(p: Noise, s: Body, u: Motion) -> Fix:
    return Fix(s.position, s.velocity[2], in_body(s.attitude, jnp.array([1.0, 0.0, 0.0])))


def arrays_retract(s: Body, e: BodyError) -> Body:
    return Body(s.position + e.position, s.velocity + e.velocity, turned(s.attitude, e.angle), s.gain + e.gain)


def arrays_local(a: Body, b: Body) -> BodyError:
    return BodyError(
        b.position - a.position, b.velocity - a.velocity, angle_between(a.attitude, b.attitude), b.gain - a.gain
    )


ARRAYS = Model(
    arrays_initial, arrays_transition, transition_noise, arrays_observation,
    lambda p, s, u: Fix(p.fix, 4.0 * p.fix, 0.01),  # one number stands for all entries of an array
    arrays_retract, arrays_local,
)  # fmt: skip

# --- in scalars ---


def scalars_initial(p: Noise) -> Belief:
    mean = Body(Vector(0.0, 0.1, 0.2), Vector(1.0, 0.0, 0.0), Quaternion(1.0, 0.0, 0.0, 0.0), 1.0)
    return Belief(mean, Covariance.from_variances(BodyError(*(Vector(v, v, v) for v in (0.04, 0.25, 1.0)), 0.01)))


def scalars_transition(p: Noise, s: Body, u: Motion, dt: Any) -> Body:
    pushed = rotated(s.attitude, scale(s.gain, u.force))
    attitude = product(s.attitude, exponential(scale(dt, u.rate)))
    return Body(add(s.position, scale(dt, s.velocity)), add(s.velocity, scale(dt, pushed)), attitude, s.gain)


def scalars_observation(p: Noise, s: Body, u: Motion) -> Fix:
    return Fix(s.position, s.velocity.z, rotated(conjugate(s.attitude), Vector(1.0, 0.0, 0.0)))


def scalars_retract(s: Body, e: BodyError) -> Body:
    attitude = product(s.attitude, exponential(e.angle))
    return Body(add(s.position, e.position), add(s.velocity, e.velocity), attitude, s.gain + e.gain)


def scalars_local(a: Body, b: Body) -> BodyError:
    angle = logarithm(product(conjugate(a.attitude), b.attitude))
    return BodyError(subtract(b.position, a.position), subtract(b.velocity, a.velocity), angle, b.gain - a.gain)


SCALARS = Model(
    scalars_initial, scalars_transition, transition_noise, scalars_observation,
    lambda p, s, u: Fix(Vector(p.fix, p.fix, p.fix), 4.0 * p.fix, Vector(0.01, 0.01, 0.01)),
    scalars_retract, scalars_local,
)  # fmt: skip

# --- both ---

P = Noise(jnp.asarray(0.01), jnp.asarray(0.2), jnp.asarray(0.02))


def columns(values: Any) -> Any:
    """Arrays (..., 3) as vectors; others stay."""
    return jax.tree.map(lambda v: Vector(*jnp.moveaxis(v, -1, 0)) if v.shape[-1:] == (3,) else v, values)


@pytest.fixture(scope="module")
def recordings() -> tuple[Fix, Motion, Fix]:
    """Observations, controls and masks, (RUNS, SAMPLES) in front."""
    rng = np.random.default_rng(0)
    time = DT * np.arange(SAMPLES)

    def near(*values: Any, spread: float) -> Any:
        return jnp.asarray(np.stack(values, -1) + spread * rng.normal(size=(RUNS, SAMPLES, 3)))

    rate = near(np.sin(time), 0.7 * np.cos(time), 0.5 + 0.0 * time, spread=0.3)
    force = near(np.cos(3.0 * time), 0.0 * time, 0.5 * np.sin(time), spread=0.3)
    place = near(time, 0.1 + 0.0 * time, 0.2 + 0.0 * time, spread=0.1)
    ahead = near(1.0 - 0.2 * time, -0.3 * time, 0.2 * time, spread=0.1)
    seen = Fix(place, jnp.asarray(0.2 * rng.normal(size=(RUNS, SAMPLES))), ahead)
    mask = Fix(*(jnp.asarray(rng.random((RUNS, SAMPLES)) > 0.3) for _ in range(3)))
    return seen, Motion(rate, force), mask


def smoothed(model: Model, p: Noise, seen: Fix, controls: Motion, mask: Fix) -> filtering.Inferred:
    return filtering.kalman_smoother(model, p, seen, controls=controls, dt=DT, mask=mask, keep=filtering.FIELDS)


def with_gradient(model: Model, p: Noise, *recording: Any) -> tuple[filtering.Inferred, Noise]:
    """Filter and smoother, and the gradient of the log-likelihood and of the smoothed path."""

    def loss(p: Noise) -> Any:
        found = smoothed(model, p, *recording)
        path = jnp.stack(jax.tree.leaves(columns(found.mean.position)))
        return jnp.sum(found.filtered.log_likelihood) + jnp.sum(path**2), found

    (_, found), slope = jax.value_and_grad(loss, has_aux=True)(p)
    return found, slope


@pytest.fixture(scope="module")
def together(recordings: Any) -> tuple[filtering.Inferred, Noise]:
    """The results of all recordings, in arrays."""
    return jax.jit(jax.vmap(lambda *recording: with_gradient(ARRAYS, P, *recording)))(*recordings)


@pytest.fixture(scope="module")
def in_scalars(recordings: Any) -> tuple[filtering.Inferred, Noise]:
    """The results of the first recording."""
    seen, controls, mask = jax.tree.map(lambda v: v[0], recordings)
    mask = Fix(*(Vector(m, m, m) if name != "rise" else m for name, m in mask._asdict().items()))
    return jax.jit(lambda *recording: with_gradient(SCALARS, P, *recording))(columns(seen), columns(controls), mask)


def numbers(found: filtering.Inferred) -> list[Any]:
    """The results in the order of the components, whatever their tuples."""

    def flat(state: Any) -> Any:
        return jnp.concatenate([jnp.reshape(v, (v.shape[0], -1)) for v in jax.tree.leaves(state)], axis=-1)

    kept = found.filtered
    states = found.mean, kept.mean, kept.predicted_mean, kept.innovation, kept.innovation_stddev
    covariances = found.cov, kept.cov, kept.predicted_cov
    return [*map(flat, states), *(cov.dense() for cov in covariances), kept.log_likelihood, kept.nis]


def same(ours: Any, theirs: Any) -> None:
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


def test_a_state_of_arrays_is_estimated_as_one_of_scalars(together, in_scalars):
    first, (theirs, _) = jax.tree.map(lambda v: v[0], together[0]), in_scalars
    same(numbers(first), numbers(theirs))


def test_gradients_are_equal(together, in_scalars):
    slopes = np.stack(together[1])
    np.testing.assert_allclose(slopes[:, 0], np.stack(in_scalars[1]), rtol=1e-9)
    assert np.all(np.abs(slopes) > 1e-3)


def test_a_recording_alone_is_as_among_others(together, recordings):
    alone = jax.jit(lambda *recording: smoothed(ARRAYS, P, *recording))(*jax.tree.map(lambda v: v[-1], recordings))
    same(jax.tree.leaves(jax.tree.map(lambda v: v[-1], together[0])), jax.tree.leaves(alone))


def test_results_have_the_shapes_of_the_state(together):
    found = jax.tree.map(lambda v: v[0], together[0])
    assert found.mean.position.shape == (SAMPLES, 3) and found.mean.gain.shape == (SAMPLES,)
    assert isinstance(found.mean.attitude, SO3) and found.mean.attitude.wxyz.shape == (SAMPLES, 4)
    np.testing.assert_allclose(np.linalg.norm(found.mean.attitude.wxyz, axis=-1), 1.0, atol=1e-9)
    assert found.cov.stddev().angle.shape == (SAMPLES, 3)
    block = found.cov["position", "velocity"]
    assert block.shape == (SAMPLES, 3, 3) and found.cov["gain", "angle"].shape == (SAMPLES, 3)
    np.testing.assert_array_equal(block, found.cov.dense()[:, 0:3, 3:6])
    np.testing.assert_array_equal(block, np.swapaxes(found.cov["velocity", "position"], 1, 2))


def test_a_wrong_shape_is_refused_by_the_name_of_its_field(recordings):
    seen, controls, _ = jax.tree.map(lambda v: v[0], recordings)

    def refused(model: Model, seen: Fix, match: str) -> None:
        with pytest.raises(ValueError, match=match):
            filtering.kalman_filter(model, P, seen, controls=controls, dt=DT)

    def flat(p: Noise, s: Body, u: Motion, dt: Any) -> Body:
        return s._replace(velocity=s.velocity[:2])

    refused(ARRAYS._replace(transition=flat), seen, r"transition returns .*'velocity' of shape \(3,\); got \(2,\)")
    spread = ARRAYS._replace(observation_noise=lambda p, s, u: Fix(jnp.ones(2), p.fix, p.fix))
    refused(spread, seen, r"observation_noise returns .*'place' of shape .*\(3,\); got \(2,\)")
    refused(ARRAYS, seen._replace(ahead=seen.ahead[:, :2]), r"'ahead' must have shape \(T, 3\).* got \(T, 2\)")
