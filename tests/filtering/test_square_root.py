"""The square-root filter: the dense one's numbers in float64, and digits that the dense one loses in float32."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait import filtering
from jgait.filtering import (
    CKF,
    EKF,
    KF,
    UKF,
    Belief,
    Covariance,
    IteratedEKF,
    Model,
    dense,
    factors,
    square_root,
)
from jgait.filtering import (
    filter as kalman,
)
from jgait.filtering.inputs import inputs

SAMPLES = 20


class State(NamedTuple):
    """Pendulum and the bias of what measures its rate."""

    angle: Any
    rate: Any
    bias: Any


class Seen(NamedTuple):
    """Shadow, measured rate, and their difference."""

    shadow: Any
    rate: Any
    mix: Any


class Push(NamedTuple):
    """Torque over the interval, and the noise of the shadow."""

    torque: Any
    spoiled: Any


class Params(NamedTuple):
    """Process noise, variance of the readings, and how nonlinear the model is."""

    q: Any = 0.3
    r: Any = 0.2
    bend: Any = 1.0


def initial(p: Params) -> Belief:
    del p
    cov = Covariance.from_variances(State(2.0, 1.0, 0.1)).with_entries({("rate", "angle"): 0.3})
    return Belief(State(0.5, -0.2, 0.1), cov)


def swing(p: Params, s: State, u: Push, dt: Any) -> State:
    return State(s.angle + dt * s.rate, s.rate + dt * (u.torque - 4.0 * p.bend * jnp.sin(s.angle)), s.bias)


def drift(p: Params, s: State, u: Push, dt: Any) -> State:
    del p
    return State(s.angle + dt * s.rate, 0.9 * s.rate + dt * u.torque, s.bias)


def process(p: Params, s: State, u: Push, dt: Any) -> Covariance:
    del s, u
    variances = State(p.q * dt**3 / 3.0, p.q * dt, 0.0)  # A constant has no noise: the covariance is singular.
    return Covariance.from_variances(variances).with_entries({("angle", "rate"): p.q * dt**2 / 2.0})


def shadow(p: Params, s: State, u: Push) -> Seen:
    del u
    return Seen(jnp.sin(p.bend * s.angle), s.rate + s.bias, s.angle - 0.5 * s.rate)


def reading(p: Params, s: State, u: Push) -> Seen:
    del p, u
    return Seen(s.angle, s.rate + s.bias, s.angle - 0.5 * s.rate)


def readings(p: Params, s: State, u: Push) -> Covariance:
    del s
    variances = Seen(p.r - u.spoiled, 2.0 * p.r, p.r)
    return Covariance.from_variances(variances).with_entries({("shadow", "mix"): 0.3 * p.r})


PENDULUM = Model(initial, swing, process, shadow, readings)
LINEAR = Model(initial, drift, process, reading, readings)


class Heading(NamedTuple):
    """A direction in the plane, and how fast it turns."""

    cosine: Any
    sine: Any
    rate: Any


class Turn(NamedTuple):
    """Its error, on a chart that bends, so that covariances turn with the point they are taken about."""

    angle: Any
    rate: Any


class Compass(NamedTuple):
    """Components of the direction."""

    north: Any
    east: Any


def heading_initial(p: Any) -> Belief:
    del p
    return Belief(Heading(1.0, 0.0, 0.4), Covariance.from_variances(Turn(0.3, 0.2)))


def rotated(s: Heading, angle: Any) -> Heading:
    cosine, sine = jnp.cos(angle), jnp.sin(angle)
    return Heading(s.cosine * cosine - s.sine * sine, s.sine * cosine + s.cosine * sine, s.rate)


def heading_retract(s: Heading, error: Turn) -> Heading:
    return rotated(s, error.angle)._replace(rate=s.rate + error.rate + 0.5 * error.angle**2)


def heading_local(a: Heading, b: Heading) -> Turn:
    angle = jnp.arctan2(a.cosine * b.sine - a.sine * b.cosine, a.cosine * b.cosine + a.sine * b.sine)
    return Turn(angle, b.rate - a.rate - 0.5 * angle**2)


HEADING = Model(
    heading_initial,
    lambda p, s, u, dt: rotated(s, dt * s.rate),
    lambda p, s, u, dt: Turn(1e-3 * dt, 1e-2 * dt),
    lambda p, s, u: Compass(s.cosine, s.sine),
    lambda p, s, u: Compass(p, p),
    heading_retract,
    heading_local,
)


class Problem(NamedTuple):
    """One recording."""

    seen: Any
    push: Any
    dt: Any
    mask: Any


def recording(shape: type = Seen) -> Problem:
    rng = np.random.default_rng(0)
    size = len(shape._fields)
    mask = rng.random((size, SAMPLES)) > 0.3
    mask[:, 7] = False
    return Problem(
        shape(*(jnp.asarray(v) for v in rng.normal(size=(size, SAMPLES)))),
        Push(jnp.asarray(rng.normal(size=SAMPLES)), jnp.zeros(SAMPLES)),
        jnp.asarray(rng.uniform(0.05, 0.4, SAMPLES)),
        shape(*(jnp.asarray(v) for v in mask)),
    )


FILTERED = (*kalman.FIELDS, "factor")


@partial(jax.jit, static_argnames=("model", "method"))
def filtered(model: Model, p: Any, problem: Problem, method: Any) -> dict[str, Any]:
    ready = inputs(model, p, problem.seen, problem.push, problem.dt, problem.mask, None).vectors()
    return square_root.scanned(ready, method, FILTERED)


@partial(jax.jit, static_argnames=("model", "method"))
def both(model: Model, p: Any, problem: Problem, method: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    ready = inputs(model, p, problem.seen, problem.push, problem.dt, problem.mask, None).vectors()
    return square_root.scanned(ready, method, FILTERED), dense.scanned(ready, method, kalman.FIELDS)


CASES = [
    (LINEAR, Params(), Seen, KF()),
    (LINEAR, Params(), Seen, UKF()),
    (PENDULUM, Params(), Seen, EKF()),
    (PENDULUM, Params(), Seen, IteratedEKF(3)),
    (PENDULUM, Params(), Seen, CKF()),
    (PENDULUM, Params(), Seen, UKF(iterations=2)),
    (HEADING, 0.05, Compass, EKF()),
    (HEADING, 0.05, Compass, IteratedEKF(2)),
    (HEADING, 0.05, Compass, UKF()),
]
NAMES = ["linear-kf", "linear-ukf", "ekf", "iterated", "ckf", "iterated-ukf", "curved", "curved-iterated", "curved-ukf"]


@pytest.mark.parametrize("model, p, shape, method", CASES, ids=NAMES)
def test_it_is_the_dense_filter(model, p, shape, method):
    ours, dense = both(model, p, recording(shape), method)
    assert bool(jnp.all(dense["valid"]))
    for name in kalman.FIELDS:
        np.testing.assert_allclose(ours[name], dense[name], rtol=1e-9, atol=1e-9, err_msg=name)
    factor = np.asarray(ours["factor"])
    np.testing.assert_array_equal(factor, np.tril(factor))
    assert np.all(np.diagonal(factor, axis1=1, axis2=2) >= 0.0)


@pytest.mark.parametrize("case", [0, 2, 5, 6, 8], ids=lambda k: NAMES[k])
def test_its_smoother_is_the_dense_smoother(case):
    model, p, shape, method = CASES[case]
    problem = recording(shape)

    @jax.jit
    def smoothed(problem: Problem) -> dict[str, Any]:
        ready = inputs(model, p, problem.seen, problem.push, problem.dt, problem.mask, None).vectors()
        return square_root.smoothed_scan(ready, square_root.scanned(ready, method, ("mean", "factor")), method)

    ours = smoothed(problem)
    dense = filtering.kalman_smoother(
        model, p, problem.seen, controls=problem.push, dt=problem.dt, mask=problem.mask, method=method
    )
    np.testing.assert_allclose(ours["mean"], np.stack(dense.mean, -1), rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours["cov"], dense.cov.dense(), rtol=0, atol=1e-9)


@pytest.mark.parametrize("smooth", [False, True])
def test_gradients_equal_finite_differences(smooth):
    problem = recording()

    @jax.jit
    @jax.value_and_grad
    def value(v: Any) -> Any:
        p = Params(jnp.exp(v[0]), jnp.exp(v[1]), v[2])
        ready = inputs(PENDULUM, p, problem.seen, problem.push, problem.dt, problem.mask, None).vectors()
        method = EKF() if smooth else IteratedEKF(2)
        kept = square_root.scanned(ready, method, ("mean", "cov", "factor", "log_likelihood"))
        out = square_root.smoothed_scan(ready, kept, method) if smooth else kept
        return jnp.sum(out["mean"][:, 0] ** 2) + jnp.sum(out["cov"][:, 1, 1]) + jnp.sum(kept["log_likelihood"])

    at = jnp.array([-1.0, -1.5, 0.7])
    gradient = value(at)[1]
    for k in range(3):
        step = jnp.zeros(3).at[k].set(1e-5)
        by_differences = (float(value(at + step)[0]) - float(value(at - step)[0])) / 2e-5
        assert float(gradient[k]) == pytest.approx(by_differences, rel=1e-5)


def test_exactly_known_states_have_finite_gradients():
    problem = recording()

    def value(q: Any) -> Any:
        known = Belief(State(0.5, 0.0, 0.1), Covariance.from_variances(State(0.0, 0.0, 0.0)))
        ready = inputs(PENDULUM, Params(q), problem.seen, problem.push, problem.dt, problem.mask, known).vectors()
        kept = square_root.scanned(ready, EKF(), ("mean", "cov", "factor"))
        out = square_root.smoothed_scan(ready, kept, EKF())
        return jnp.sum(out["mean"]) + jnp.sum(out["cov"]) + jnp.sum(kept["cov"])

    run = jax.jit(jax.value_and_grad(value))
    for q in (0.0, 0.3):
        level, slope = run(jnp.asarray(q))
        assert np.isfinite(float(level)) and np.isfinite(float(slope))
    assert float(slope) != 0.0


def test_a_broken_step_keeps_the_belief_and_is_not_valid():
    problem = recording()
    spoiled = problem.push.spoiled.at[1].set(30.0)
    whole = jax.tree.map(jnp.ones_like, problem.mask)
    out = filtered(PENDULUM, Params(), problem._replace(push=problem.push._replace(spoiled=spoiled), mask=whole), EKF())
    np.testing.assert_array_equal(out["valid"], np.arange(SAMPLES) != 1)
    np.testing.assert_array_equal(out["mean"][1], out["predicted_mean"][1])
    np.testing.assert_array_equal(out["cov"][1], out["predicted_cov"][1])
    for name in ("innovation", "innovation_stddev", "log_likelihood", "nis", "count"):
        assert not np.any(np.asarray(out[name][1])), name
    # An interval that leads to infinity: the belief before it is what is updated.
    torque = problem.push.torque.at[3].set(1e300)
    far = problem._replace(push=problem.push._replace(torque=torque), dt=problem.dt.at[3].set(1e20), mask=whole)
    out = filtered(PENDULUM, Params(), far, EKF())
    np.testing.assert_array_equal(out["valid"], np.arange(SAMPLES) != 3)
    np.testing.assert_array_equal(out["predicted_mean"][3], out["mean"][2])
    np.testing.assert_allclose(out["predicted_cov"][3], out["cov"][2], rtol=1e-14)
    assert all(np.all(np.isfinite(np.asarray(v))) for v in out.values())

    def level(p: Params) -> Any:
        out = filtered(PENDULUM, p, far, EKF())
        return jnp.sum(out["mean"]) + jnp.sum(out["cov"]) + jnp.sum(out["log_likelihood"])

    assert all(np.isfinite(float(v)) for v in jax.jit(jax.grad(level))(Params(*map(jnp.asarray, Params()))))


def test_a_first_covariance_that_is_none_is_marked():
    problem = recording()
    cov = Covariance.from_variances(State(1.0, 1.0, 0.1)).with_entries({("rate", "angle"): 1.5})
    ready = inputs(
        LINEAR, Params(), problem.seen, problem.push, problem.dt, problem.mask, Belief(State(0.5, 0.0, 0.1), cov)
    ).vectors()
    valid = square_root.scanned(ready, EKF(), ("valid",))["valid"]
    np.testing.assert_array_equal(valid, np.arange(SAMPLES) > 0)


@pytest.mark.parametrize("rows", ["full", "zero", "twice"])
def test_triangular_factors(rows):
    a = np.random.default_rng(3).normal(size=(4, 6))
    a = a * np.array([1.0, 1e3, 1e-4, 1.0])[:, None]
    if rows == "zero":
        a[1] = 0.0
    if rows == "twice":
        a[3] = 2.0 * a[1]
    a = jnp.asarray(a)
    lower = np.asarray(jax.jit(factors.triangularised)(a))
    scale = np.sqrt(np.sum(np.asarray(a) ** 2, axis=1) + 1e-300)
    np.testing.assert_array_equal(lower, np.tril(lower))
    assert np.all(np.diagonal(lower) >= 0.0)
    np.testing.assert_allclose(lower @ lower.T / np.outer(scale, scale), a @ a.T / np.outer(scale, scale), atol=1e-14)
    # The same array as a factor that changes: the sum of the two numbers it is carried as.
    zero = jnp.zeros((4, 4))
    factor, rest = jax.jit(factors.changed)(zero, zero, a[:, :4], a[:, 4:])
    total = np.asarray(factor) + np.asarray(rest)
    np.testing.assert_allclose(total @ total.T / np.outer(scale, scale), a @ a.T / np.outer(scale, scale), atol=1e-14)

    weight = jnp.asarray(np.random.default_rng(4).normal(size=(4, 4)))
    for form in (factors.triangularised, lambda v: factors.changed(zero, zero, v[:, :4], v[:, 4:])[0]):
        gradient = jax.jit(jax.grad(lambda v, form=form: jnp.sum(weight * form(v))))(a)
        assert bool(jnp.all(jnp.isfinite(gradient)))
        if rows == "full":

            def product(v: Any, form: Any = form) -> Any:
                return jnp.sum(weight * factors.covariance(form(v)))

            np.testing.assert_allclose(jax.jit(jax.grad(product))(a), (weight + weight.T) @ a, rtol=1e-9, atol=1e-9)


class Walker(NamedTuple):
    """Position, velocity, and the bias of the accelerometer."""

    position: Any
    velocity: Any
    bias: Any


class Still(NamedTuple):
    """The velocity that is known while a foot stands."""

    velocity: Any


class Force(NamedTuple):
    """Measured acceleration."""

    acceleration: Any


def walker_initial(p: Any) -> Belief:
    zero = jnp.zeros_like(p)
    return Belief(Walker(zero + 1.0, zero, zero), Covariance.from_variances(Walker(100.0, 100.0, 1.0)))


def walker_transition(p: Any, s: Walker, u: Force, dt: Any) -> Walker:
    del p
    a = u.acceleration - s.bias
    return Walker(s.position + dt * s.velocity + 0.5 * dt * dt * a, s.velocity + dt * a, s.bias)


ZERO_VELOCITY = Model(
    walker_initial,
    walker_transition,
    lambda p, s, u, dt: Walker(1e-6 * dt, 1e-2 * dt, 1e-6 * dt),
    lambda p, s, u: Still(s.velocity),
    lambda p, s, u: Still(p),
)


@pytest.mark.parametrize("standing", ["always", "half of every second and a half"])
def test_five_digits_of_a_tight_zero_velocity_problem_in_float32(standing):
    samples = 50_000
    rng = np.random.default_rng(0)
    velocity, force = (scale * rng.normal(size=samples).astype(np.float32) for scale in (1e-3, 1e-2))
    mask = np.arange(samples) % 150 < (75 if standing != "always" else 150)

    @partial(jax.jit, static_argnames="scan")
    def run(scan: Any, velocity: Any, force: Any) -> Any:
        kind = velocity.dtype
        ready = inputs(
            ZERO_VELOCITY, jnp.asarray(1e-6, kind), Still(velocity), Force(force), jnp.asarray(0.01, kind), mask, None
        ).vectors()
        kept = scan(ready, EKF(), ("mean", "cov"))
        return kept["mean"], jnp.diagonal(kept["cov"], axis1=1, axis2=2)

    def numbers(scan: Any, kind: Any) -> Any:
        return [np.asarray(v, np.float64) for v in run(scan, jnp.asarray(velocity, kind), jnp.asarray(force, kind))]

    mean, variance = numbers(dense.scanned, jnp.float64)
    error = {}
    for name, scan in (("root", square_root.scanned), ("joseph", dense.scanned)):
        means, variances = numbers(scan, jnp.float32)
        error[name] = np.max(np.abs(variances / variance - 1.0)), np.max(np.abs(means - mean) / np.sqrt(variance))
    print(error)
    assert max(error["root"]) < 1e-5
    assert error["joseph"][0] > 10.0 * error["root"][0]
