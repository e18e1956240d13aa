"""The parallel filter and smoother: the sequential ones' numbers, whatever the length."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference

from jgait import filtering
from jgait.filtering import KF, Belief, Covariance, Model, parallel
from jgait.filtering import filter as kalman
from jgait.filtering.inputs import PreparedInputs, inputs


class Pendulum(NamedTuple):
    """Angle from hanging, and its rate."""

    angle: Any
    rate: Any


class Seen(NamedTuple):
    """Shadow and rate."""

    shadow: Any
    rate: Any


class Push(NamedTuple):
    """Torque over the interval, and what is taken off the shadow's variance."""

    torque: Any
    spoiled: Any


class Params(NamedTuple):
    """Process noise, variance of the readings, stiffness."""

    q: Any = 0.3
    r: Any = 0.2
    stiffness: Any = 4.0


def initial(p: Params) -> Belief:
    del p
    cov = Covariance.from_variances(Pendulum(1.0, 0.5)).with_entries({("rate", "angle"): 0.2})
    return Belief(Pendulum(0.5, -0.2), cov)


def swing(p: Params, s: Pendulum, u: Push, dt: Any) -> Pendulum:
    return Pendulum(s.angle + dt * s.rate, s.rate + dt * (u.torque - p.stiffness * jnp.sin(s.angle)))


def spring(p: Params, s: Pendulum, u: Push, dt: Any) -> Pendulum:
    return Pendulum(s.angle + dt * s.rate, s.rate + dt * (u.torque - p.stiffness * s.angle))


def process(p: Params, s: Pendulum, u: Push, dt: Any) -> Covariance:
    del s, u
    return Covariance.from_variances(Pendulum(p.q * dt**3 / 3.0, p.q * dt)).with_entries(
        {("angle", "rate"): p.q * dt**2 / 2.0}
    )


def shadow(p: Params, s: Pendulum, u: Push) -> Seen:
    del p
    return Seen(jnp.sin(s.angle), s.rate + 0.1 * u.torque)


def readings(p: Params, s: Pendulum, u: Push) -> Covariance:
    del s
    return Covariance.from_variances(Seen(p.r - u.spoiled, 2.0 * p.r)).with_entries({("shadow", "rate"): 0.3 * p.r})


def direct(p: Params, s: Pendulum, u: Push) -> Seen:
    del p
    return Seen(s.angle, s.rate + 0.1 * u.torque)


PENDULUM = Model(initial, swing, process, shadow, readings)
LINEAR = Model(initial, spring, process, direct, readings)


class Problem(NamedTuple):
    """One recording."""

    seen: Seen
    push: Push
    dt: Any
    mask: Seen


def recording(samples: int) -> Problem:
    rng = np.random.default_rng(samples)
    mask = rng.random((2, samples)) > 0.3
    mask[:, samples // 2] = samples == 1
    return Problem(
        Seen(*(jnp.asarray(0.5 * v) for v in rng.normal(size=(2, samples)))),
        Push(jnp.asarray(rng.normal(size=samples)), jnp.zeros(samples)),
        jnp.asarray(rng.uniform(0.02, 0.2, samples)),
        Seen(*(jnp.asarray(v) for v in mask)),
    )


@partial(jax.jit, static_argnames="model")
def smoothed(model: Model, p: Params, problem: Problem, about: Any = None) -> dict[str, Any]:
    ready = inputs(model, p, problem.seen, problem.push, problem.dt, problem.mask, None).vectors()
    return parallel.parallel_smoother(ready, about)


@pytest.mark.parametrize("samples", [1, 2, 16, 37])
def test_it_is_the_kalman_filter_and_smoother(samples):
    problem = recording(samples)
    ours = smoothed(LINEAR, Params(), problem)
    theirs = filtering.kalman_smoother(
        LINEAR, Params(), problem.seen, controls=problem.push, dt=problem.dt, mask=problem.mask, method=KF(),
        keep=kalman.FIELDS,
    )  # fmt: skip
    np.testing.assert_allclose(ours["mean"], np.stack(theirs.mean, -1), rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours["cov"], theirs.cov.dense(), rtol=0, atol=1e-9)
    for name in kalman.FIELDS:
        value = getattr(theirs.filtered, name)
        value = value.dense() if name.endswith("cov") else value
        value = np.stack(value, -1) if isinstance(value, Seen | Pendulum) else value
        np.testing.assert_allclose(ours["filtered"][name], value, rtol=0, atol=1e-9, err_msg=name)
    # The filter alone gives the same.
    ready = inputs(LINEAR, Params(), problem.seen, problem.push, problem.dt, problem.mask, None).vectors()
    alone = jax.jit(lambda: parallel.parallel_filter(ready))() if samples == 2 else ours["filtered"]
    np.testing.assert_allclose(alone["mean"], ours["filtered"]["mean"], rtol=0, atol=1e-13)


def test_about_a_trajectory_it_is_the_kalman_filter_of_the_linearised_model():
    problem, p = recording(13), Params()
    about = np.random.default_rng(5).normal(size=(13, 2))
    ours = smoothed(PENDULUM, p, problem, jnp.asarray(about))
    samples, x = [], np.array([0.5, -0.2])
    for k, dt in enumerate(np.asarray(problem.dt)):
        torque, at = float(problem.push.torque[k]), about[k]
        F = np.array([[1.0, dt], [-dt * 4.0 * np.cos(x[0]), 1.0]])
        b = np.array([x[0] + dt * x[1], x[1] + dt * (torque - 4.0 * np.sin(x[0]))]) - F @ x
        Q = p.q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        H = np.array([[np.cos(at[0]), 0.0], [0.0, 1.0]])
        c = np.array([np.sin(at[0]), at[1] + 0.1 * torque]) - H @ at
        R = p.r * np.array([[1.0, 0.3], [0.3, 2.0]])
        y, seen = (np.array([leaf[k] for leaf in tree]) for tree in (problem.seen, problem.mask))
        samples.append(reference.linear_sample(F, b, Q, H, c, R, y, seen))
        x = at
    expected = reference.extended_filter(np.array([0.5, -0.2]), np.array([[1.0, 0.2], [0.2, 0.5]]), samples)
    for name in ("mean", "cov", "log_likelihood", "nis"):
        np.testing.assert_allclose(ours["filtered"][name], getattr(expected, name), rtol=0, atol=1e-10, err_msg=name)
    means, covs = reference.smoother(expected, samples)
    np.testing.assert_allclose(ours["mean"], means, rtol=0, atol=1e-10)
    np.testing.assert_allclose(ours["cov"], covs, rtol=0, atol=1e-10)


def test_rounds_about_their_own_result_end_at_the_most_probable_trajectory():
    samples, p = 24, Params(q=2.0)
    problem = recording(samples)
    about = jnp.zeros((samples, 2))
    for _ in range(40):
        about, before = smoothed(PENDULUM, p, problem, about)["mean"], about
    np.testing.assert_allclose(about, before, rtol=0, atol=1e-12)

    # Its density, written out: the first state given the initial belief, then transitions and seen measurements.
    mean, cov = np.array([0.5, -0.2]), np.array([[1.0, 0.2], [0.2, 0.5]])
    dt, readings, mask = (np.stack(v, -1) for v in ([problem.dt], problem.seen, problem.mask))
    noise = p.q * np.array([[[h**3 / 3, h**2 / 2], [h**2 / 2, h]] for h in dt[:, 0]])
    F = np.array([[1.0, dt[0, 0]], [-dt[0, 0] * 4.0 * np.cos(mean[0]), 1.0]])
    noise[0] += F @ cov @ F.T
    R = p.r * np.array([[1.0, 0.3], [0.3, 2.0]])
    weights = np.zeros((samples, 2, 2))
    for k, seen in enumerate(mask):
        rows = np.ix_(seen, seen)
        weights[k][rows] = np.linalg.inv(R[rows])

    def minus_log_density(states: Any) -> Any:
        origins = Pendulum(*jnp.concatenate([jnp.asarray(mean)[None], states[:-1]]).T)
        steps = states - jnp.stack(swing(p, origins, problem.push, problem.dt), -1)
        errors = jnp.asarray(readings) - jnp.stack(shadow(p, Pendulum(*states.T), problem.push), -1)
        terms = ((steps, np.linalg.inv(noise)), (errors, weights))
        return sum(0.5 * jnp.einsum("ti,tij,tj", v, jnp.asarray(w), v) for v, w in terms)

    slope = jax.jit(jax.grad(minus_log_density))
    assert float(jnp.max(jnp.abs(slope(jnp.zeros((samples, 2)))))) > 1.0
    np.testing.assert_allclose(slope(about), 0.0, atol=1e-7)


def test_gradients_equal_finite_differences():
    problem = recording(13)
    about = jnp.asarray(np.random.default_rng(5).normal(size=(13, 2)))

    @jax.jit
    @jax.value_and_grad
    def value(v: Any) -> Any:
        out = smoothed(PENDULUM, Params(jnp.exp(v[0]), jnp.exp(v[1]), v[2]), problem, about)
        filtered = out["filtered"]
        return jnp.sum(out["mean"][:, 0] ** 2) + jnp.sum(out["cov"][:, 1, 1]) + jnp.sum(filtered["log_likelihood"])

    at = jnp.array([-1.0, -1.5, 4.0])
    gradient = value(at)[1]
    for k in range(3):
        step = jnp.zeros(3).at[k].set(1e-5)
        by_differences = (float(value(at + step)[0]) - float(value(at - step)[0])) / 2e-5
        assert float(gradient[k]) == pytest.approx(by_differences, rel=1e-5)


def test_what_the_mask_hides_changes_nothing_and_a_broken_sample_is_left_out():
    problem = recording(16)
    hidden = problem._replace(seen=jax.tree.map(lambda v, m: jnp.where(m, v, 1e6), problem.seen, problem.mask))
    plain = smoothed(LINEAR, Params(), problem)
    for a, b in zip(jax.tree.leaves(plain), jax.tree.leaves(smoothed(LINEAR, Params(), hidden)), strict=True):
        np.testing.assert_array_equal(a, b)
    whole = problem._replace(mask=jax.tree.map(jnp.ones_like, problem.mask))
    broken = whole._replace(push=whole.push._replace(spoiled=whole.push.spoiled.at[5].set(30.0)))
    without = whole._replace(mask=jax.tree.map(lambda leaf: leaf.at[5].set(False), whole.mask))
    ours, expected = smoothed(LINEAR, Params(), broken), smoothed(LINEAR, Params(), without)
    np.testing.assert_array_equal(ours["filtered"]["valid"], np.arange(16) != 5)
    for name in ("log_likelihood", "nis", "count"):
        assert float(ours["filtered"][name][5]) == 0.0
    np.testing.assert_allclose(ours["mean"], expected["mean"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours["filtered"]["cov"], expected["filtered"]["cov"], rtol=0, atol=1e-12)


def test_it_refuses_what_it_cannot_do():
    problem = recording(3)

    def ready(model: Model) -> PreparedInputs:
        return inputs(model, Params(), problem.seen, problem.push, problem.dt, problem.mask, None).vectors()

    with pytest.raises(ValueError, match="the KF needs a linear model"):
        parallel.parallel_filter(ready(PENDULUM))
    with pytest.raises(ValueError, match=r"about must be states over time of shape \(3, 2\); got shape \(2, 2\)"):
        parallel.parallel_filter(ready(PENDULUM), jnp.zeros((2, 2)))

    def plus(a: Pendulum, b: Pendulum) -> Pendulum:
        return Pendulum(a.angle + b.angle, a.rate + b.rate)

    def minus(a: Pendulum, b: Pendulum) -> Pendulum:
        return Pendulum(b.angle - a.angle, b.rate - a.rate)

    with pytest.raises(ValueError, match="needs a model whose states are vectors"):
        parallel.parallel_smoother(ready(LINEAR._replace(retract=plus, local=minus)))
