"""States of arrays and of attitudes: as scalars, consistent with their own covariance, and a curved line by hand."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering.problems import CART, LINE, Cart, Place, case, smoothed
from jaxlie import SO3

from jgait import filtering
from jgait.filtering import FIELDS, KF, Belief, Covariance, Model, draw

DT, SAMPLES, RUNS = 0.05, 60, 30

# jaxlie multiplies floats by arrays of whole numbers, which the tests' promotion of types refuses.
usual_promotion = jax.numpy_dtype_promotion("standard")


class Pair(NamedTuple):
    """Two numbers as an array."""

    both: Any


def paired(function: Any, noise: bool = False) -> Any:
    """A function of `CART` as one of arrays."""

    def of_arrays(p: Any, s: Pair, *rest: Any) -> Any:
        found = function(p, Cart(*s.both), *rest)
        return Covariance.from_dense(found.dense(), Pair(jnp.zeros(2))) if noise else Pair(jnp.stack(found))

    return of_arrays


def test_a_state_of_arrays_is_estimated_as_one_of_scalars():
    c = case("cart")
    mean, cov = CART.initial(c.params)
    arrays = Model(
        lambda p: Belief(Pair(jnp.stack(mean)), Covariance.from_dense(cov.dense(), Pair(jnp.zeros(2)))),
        paired(CART.transition), paired(CART.transition_noise, True), paired(CART.observation),
        paired(CART.observation_noise, True),
    )  # fmt: skip
    seen, mask = (Pair(jnp.stack(each, axis=-1)) for each in (c.observations, c.mask))
    ours = filtering.kalman_smoother(arrays, c.params, seen, controls=c.controls, dt=c.dt, mask=mask, keep=FIELDS)
    theirs = smoothed(c, keep=FIELDS)
    for name in FIELDS:
        found, expected = getattr(ours.filtered, name), getattr(theirs.filtered, name)
        pairs = ((found.both, jnp.stack(expected, -1)) if isinstance(found, Pair) else (found, expected),)
        if isinstance(found, Covariance):
            pairs = ((found.dense(), expected.dense()),)
        for a, b in (*pairs, (ours.mean.both, jnp.stack(theirs.mean, -1)), (ours.cov.dense(), theirs.cov.dense())):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9, err_msg=name)


class Body(NamedTuple):
    """Position, attitude from the body to the world, and the gyroscope's bias."""

    position: Any
    attitude: Any
    bias: Any


class BodyError(NamedTuple):
    """The same with a rotation vector in body axes."""

    position: Any
    angle: Any
    bias: Any


class Fix(NamedTuple):
    """Where it is, and the world's up and north, seen from the body."""

    place: Any
    up: Any
    north: Any


class Motion(NamedTuple):
    """Angular rate in body axes and velocity in the world."""

    rate: Any
    velocity: Any


@usual_promotion
def transition(p: Any, s: Body, u: Motion, dt: Any) -> Body:
    return Body(s.position + dt * u.velocity, s.attitude @ SO3.exp((u.rate - s.bias) * dt), s.bias)


@usual_promotion
def observation(p: Any, s: Body, u: Motion) -> Fix:
    return Fix(s.position, *(s.attitude.inverse() @ jnp.array(axis) for axis in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0])))


@usual_promotion
def retract(s: Body, e: BodyError) -> Body:
    return Body(s.position + e.position, s.attitude @ SO3.exp(e.angle), s.bias + e.bias)


@usual_promotion
def local(a: Body, b: Body) -> BodyError:
    return BodyError(b.position - a.position, (a.attitude.inverse() @ b.attitude).log(), b.bias - a.bias)


def initial(p: Any) -> Belief:
    variances = BodyError(jnp.full(3, 0.04), jnp.full(3, 0.25), jnp.full(3, 0.01))
    return Belief(Body(jnp.zeros(3), SO3(jnp.array([1.0, 0.0, 0.0, 0.0])), jnp.zeros(3)),
                  Covariance.from_variances(variances))  # fmt: skip


BODY = Model(
    initial, transition, lambda p, s, u, dt: BodyError(1e-3 * dt, 4e-4 * dt, 1e-6 * dt), observation,
    lambda p, s, u: Fix(4.0 * p, p, p),  # one number stands for all entries of an array
    retract, local,
)  # fmt: skip
NOISE = 0.05**2


@pytest.fixture(scope="module")
def tumble() -> tuple[Body, Fix, Motion]:
    """Runs (RUNS, SAMPLES) of a tumbling body: its truth, drawn from the model, what is seen, and its motion."""
    time = DT * jnp.arange(float(SAMPLES))
    rate = jnp.stack([2.0 * jnp.sin(time), 1.5 * jnp.cos(0.7 * time), 1.0 + jnp.sin(1.3 * time)], axis=-1)
    motion = Motion(rate, jnp.stack([jnp.ones_like(time), time, -time], axis=-1))
    keys = jax.random.split(jax.random.key(1), RUNS)
    drawn = jax.jit(jax.vmap(lambda k: draw(k, BODY, jnp.asarray(NOISE), SAMPLES, controls=motion, dt=DT)))(keys)
    return jax.tree.map(np.asarray, (*drawn, motion))


def test_a_tumbling_body_is_estimated_and_its_covariance_is_that_of_the_error(tumble):
    truth, seen, motion = tumble

    def solve(truth: Body, seen: Fix) -> Any:
        found = filtering.kalman_smoother(BODY, NOISE, seen, controls=motion, dt=DT, keep=("mean", "cov", "nis"))
        errors = [jnp.concatenate(jax.vmap(local)(mean, truth), axis=-1) for mean in (found.filtered.mean, found.mean)]
        return found, errors

    found, errors = jax.jit(jax.vmap(solve))(truth, seen)
    assert found.cov.names == ("position", "angle", "bias") and isinstance(found.mean.attitude, SO3)
    assert found.mean.attitude.wxyz.shape == (RUNS, SAMPLES, 4) and found.cov.stddev().angle.shape == truth.bias.shape
    np.testing.assert_allclose(np.linalg.norm(found.mean.attitude.wxyz, axis=-1), 1.0, atol=1e-9)
    filtered, smoothed = map(np.asarray, errors)
    assert np.degrees(np.abs(filtered[:, 20:, 3:6])).max() < 5.0
    assert np.sqrt(np.mean(smoothed**2)) < 0.8 * np.sqrt(np.mean(filtered**2))
    late = slice(20, None, 20)  # far enough apart for the runs' errors to be nearly independent
    for error, cov in ((filtered, found.filtered.cov), (smoothed, found.cov)):
        dense = np.asarray(cov.dense())
        np.testing.assert_array_equal(dense, np.swapaxes(dense, -1, -2))
        ratio = np.einsum("...i,...ij,...j->...", error, np.linalg.inv(dense), error)[:, late]
        assert abs(ratio.mean() - 9.0) < 6.0 * np.sqrt(18.0 / ratio.size)
        np.testing.assert_array_equal(cov["position", "angle"], dense[..., 0:3, 3:6])
    nis = np.asarray(found.filtered.nis)[:, late]
    assert abs(nis.mean() - 9.0) < 6.0 * np.sqrt(18.0 / nis.size)


def test_a_wrong_shape_is_refused_by_the_name_of_its_field_and_a_rotation_by_the_kf(tumble):
    seen, motion = jax.tree.map(lambda v: v[0], tumble[1]), tumble[2]

    def refused(model: Model, seen: Fix, match: str, **more: Any) -> None:
        with pytest.raises(ValueError, match=match):
            filtering.kalman_filter(model, NOISE, seen, controls=motion, dt=DT, **more)

    flat = BODY._replace(transition=lambda p, s, u, dt: s._replace(bias=s.bias[:2]))
    refused(flat, seen, r"transition returns .*'bias' of shape \(3,\); got \(2,\)")
    spread = BODY._replace(observation_noise=lambda p, s, u: Fix(jnp.ones(2), p, p))
    refused(spread, seen, r"observation_noise returns .*'place' of shape .*\(3,\); got \(2,\)")
    refused(BODY, seen._replace(up=seen.up[:, :2]), r"'up' must have shape \(T, 3\).* got \(T, 2\)")
    refused(BODY, seen, "KF needs a linear model", method=KF())


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
