"""The core against plain matrices: every model and method, in batches of any shape, and where numbers fail."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering.oracle import estimated, stacked
from filtering.problems import BROKEN, SAMPLES, Cart, Case, Push, Reading, case, filtered, same, smoothed
from scipy import stats

from experiments.benchmark.core import foot, smoother
from jgait import filtering
from jgait.filtering import CKF, EKF, FIELDS, KF, UKF, Belief, Covariance, IteratedEKF, Model, batch
from jgait.filtering.inputs import checked
from jgait.filtering.posterior import Posterior
from jgait.filtering.scan import Recorded


def close(found: Any, expected: Any, name: str) -> None:
    array = found.dense() if isinstance(found, Covariance) else stacked(found) if isinstance(found, tuple) else found
    np.testing.assert_allclose(array, expected, rtol=1e-8, atol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    ("name", "method", "masked"),
    [
        ("cart", KF(), True), ("cart", CKF(), False), ("cart", IteratedEKF(5), True), ("cart", UKF(iterations=3), True),
        ("bent", EKF(), False), ("bent", IteratedEKF(3), True),
        ("bent", UKF(0.8, 1.5, 0.5), True), ("bent", CKF(2), True), ("heading", EKF(), True), ("heading", UKF(), True),
        ("heading", IteratedEKF(2), True), ("heading", CKF(), False),
    ],
    ids=str,
)  # fmt: skip
def test_it_is_the_oracle(name, method, masked):
    c = case(name, masked=masked)
    expected = estimated(c, method)
    found = smoothed(c, "core", method, keep=FIELDS)
    for field in FIELDS:
        if field != "valid":
            close(getattr(found.filtered, field), getattr(expected, field), field)
    assert bool(jnp.all(found.filtered.valid))
    close(found.mean, expected.smoothed_mean, "smoothed mean")
    close(found.cov, expected.smoothed_cov, "smoothed covariance")


@pytest.mark.parametrize(("name", "component"), [("cart", "speed"), ("heading", "rate")])
def test_selected_covariances_are_those_of_all(name, component):
    c = case(name)
    every, some, none = (smoothed(c, covariance=which) for which in (True, (component,), False))
    assert some.cov.names == (component,) and none.cov is None
    same(some.cov[component, component], every.cov[component, component])
    for found in (some, none):
        same(found.mean, every.mean)


def solved(c: Any, p: Any, observations: Any) -> Any:
    found = smoothed(c._replace(params=p, observations=observations), keep=("mean", "cov", "log_likelihood"))
    return found.mean, found.cov.dense(), found.filtered.mean, found.filtered.log_likelihood


@pytest.mark.parametrize("name", ["bent", "heading"])
def test_batches_of_any_shape_are_the_single_results(name):
    c = case(name, 5)
    ready = checked(c.model, c.params, c.observations, c.controls, c.dt, c.mask, None)
    block = Recorded(ready.shape, EKF(), ("x",)).block
    rng = np.random.default_rng(0)
    params = np.asarray(c.params) * rng.uniform(0.5, 2.0, (3, 4))
    batch = Reading(*(rng.normal(size=(block + 1, 5)) for _ in range(2)))
    one = jax.jit(lambda p, y: solved(c, p, y))

    def at(tree: Any, i: Any) -> Any:
        return jax.tree.map(lambda leaf: leaf[i], tree)

    def computed(function: Any, *given: Any) -> Any:
        return jax.tree.map(np.asarray, jax.jit(function)(*given))

    alone = [[one(p, at(batch, j)) for j in range(block + 1)] for p in params]
    for size in (1, block, block + 1) if name == "bent" else (block + 1,):
        found = computed(jax.vmap(one, (None, 0)), params[1], at(batch, slice(size)))
        for j in range(size):
            same(at(found, j), alone[1][j])
    found = computed(jax.vmap(one, (0, None)), params, at(batch, 2))
    for i in range(3):
        same(at(found, i), alone[i][2])
    # Both, one within the other; the batch axis of the readings is their last.
    last = jax.tree.map(np.transpose, at(batch, slice(7)))
    inside = jax.vmap(jax.vmap(one, (None, 1)), (0, None))
    outside = jax.vmap(jax.vmap(one, (0, None)), (None, 1), out_axes=1)
    found = computed(inside if name == "bent" else outside, params, last)
    for i, j in ((0, 0), (1, 6), (2, 3)):
        same(at(found, (i, j)), alone[i][j])


WRONG = 5
"""The sample at which a function fails."""


def broken(kind: str) -> tuple[Case, Case]:
    """A case whose function fails at one sample, and the same that does not see the sample: of one program."""
    c = case("bent", masked=False)._replace(model=BROKEN)
    here = np.arange(SAMPLES)
    every, others = (Reading(*(jnp.asarray(seen),) * 2) for seen in (here >= 0, here != WRONG))
    fault = c.controls.fault._replace(**{kind: jnp.asarray(np.where(here == WRONG, 800.0, 0.0))})
    return c._replace(controls=c.controls._replace(fault=fault), mask=every), c._replace(mask=others)


@pytest.mark.parametrize("kind", ["transition", "observation", "noise"])
def test_a_sample_that_is_not_finite_is_marked_and_keeps_the_belief(kind):
    c, unseen = broken(kind)
    whole = jax.tree.map(np.asarray, smoothed(c, keep=FIELDS))
    found = whole.filtered
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(whole))
    np.testing.assert_array_equal(found.valid, np.arange(SAMPLES) != WRONG)
    for told in (found.innovation, found.innovation_stddev, found.log_likelihood, found.nis, found.count):
        assert not np.any([leaf[WRONG] for leaf in jax.tree.leaves(told)])
    now = jax.tree.map(lambda leaf: leaf[WRONG], found)
    if kind != "transition":
        expected = smoothed(unseen, keep=FIELDS)
        same((whole.mean, whole.cov), (expected.mean, expected.cov))
        return
    before = jax.tree.map(lambda leaf: leaf[WRONG - 1], found)
    same((now.mean, now.cov), (before.mean, before.cov))
    rest = jax.tree.map(lambda leaf: np.asarray(leaf)[WRONG + 1 :], (c.observations, c.controls, c.mask))
    later = filtered(
        c._replace(observations=rest[0], controls=rest[1], mask=rest[2]), initial=Belief(before.mean, before.cov),
        keep=("mean",),
    )  # fmt: skip
    same(later.mean, jax.tree.map(lambda leaf: leaf[WRONG + 1 :], found.mean))


@functools.cache
def slopes(gradient: Any) -> Any:
    """The program of a gradient of states, covariances and the likelihood by parameters and controls."""

    mode = "reverse" if gradient is jax.grad else "forward"

    def loss(p: Any, acceleration: Any, c: Any) -> Any:
        controls = c.controls._replace(acceleration=acceleration)
        found = smoothed(c._replace(params=p, model=BROKEN, controls=controls), method=EKF(derivative=mode))
        states = jnp.sum(found.mean.position**2) + jnp.sum(found.cov["position", "speed"])
        return states + jnp.sum(found.filtered.log_likelihood)

    return jax.jit(lambda *given: gradient(loss, (0, 1))(*given))


@pytest.mark.parametrize("kind", ["transition", "observation", "noise"])
def test_gradients_pass_over_a_sample_that_is_not_finite(kind):
    def found(gradient: Any, c: Case) -> Any:
        given = c.params, c.controls.acceleration, c._replace(model=None)
        return jax.tree.map(np.asarray, slopes(gradient)(*given))

    c, unseen = broken(kind)
    ours = found(jax.grad, c)
    assert all(np.all(np.isfinite(leaf)) for leaf in ours)
    same(ours, found(jax.jacfwd, c), 1e-8)
    if kind != "transition":
        same(ours, found(jax.grad, unseen), 1e-8)


@pytest.mark.parametrize(("name", "method"), [("bent", EKF()), ("heading", EKF()), ("line", UKF())], ids=str)
def test_a_step_is_a_sample_of_the_filter(name, method):
    c = case(name)
    whole = filtered(c, "core", method)
    belief = c.model.initial(c.params)
    for k in range(SAMPLES):

        def now(tree: Any, k: int = k) -> Any:
            return jax.tree.map(lambda leaf: leaf[k], tree)

        told = filtering.step(
            c.model, c.params, belief, now(c.observations), control=now(c.controls), dt=c.dt[k], mask=now(c.mask),
            method=method,
        )  # fmt: skip
        belief = told.belief()
        same(told, now(whole), 1e-12)


def test_an_initial_covariance_that_is_none_is_marked():
    c = case("cart", masked=False)
    cov = Covariance.from_variances(Cart(1.0, 1.0)).with_entries({("position", "speed"): 30.0})
    found = filtered(c, initial=Belief(Cart(0.0, 0.0), cov))
    assert not bool(found.valid[0])
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(found))


class Walker(NamedTuple):
    """Position, velocity, and the bias of the accelerometer."""

    position: Any
    velocity: Any
    bias: Any


class Still(NamedTuple):
    """The velocity that is known while a foot stands."""

    velocity: Any


def walker_transition(p: Any, s: Walker, u: Push, dt: Any) -> Walker:
    a = u.acceleration - s.bias
    return Walker(s.position + dt * s.velocity + 0.5 * dt * dt * a, s.velocity + dt * a, s.bias)


ZERO_VELOCITY = Model(
    lambda p: Belief(Walker(1.0, 0.0, 0.0), Covariance.from_variances(Walker(100.0, 100.0, 1.0))),
    walker_transition,
    lambda p, s, u, dt: Walker(1e-6 * dt, 1e-2 * dt, 1e-6 * dt),
    lambda p, s, u: Still(s.velocity),
    lambda p, s, u: Still(p),
)


@pytest.mark.parametrize(("execution", "standing"), [("core", 75), ("core", 150), ("fast", 75)])
def test_a_tight_zero_velocity_problem_in_float32(execution, standing):
    """Position, velocity and bias of an accelerometer for minutes; standing feet are known to a millimetre a second."""
    samples = 15_000
    rng = np.random.default_rng(0)
    velocity, force = (scale * rng.normal(size=samples) for scale in (1e-3, 1e-2))
    c = Case(ZERO_VELOCITY, 1e-6, Still(velocity), Push(force, None), 0.01, np.arange(samples) % 150 < standing)

    def found(kind: Any) -> Any:
        cast = jax.tree.map(lambda v: v if np.result_type(v).kind == "b" else jnp.asarray(v, kind), tuple(c)[1:])
        told = filtered(Case(c.model, *cast), execution, keep=("mean", "cov", "valid"))
        assert told.mean.velocity.dtype == kind and bool(jnp.all(told.valid))
        return [np.asarray(stacked(tree), np.float64) for tree in (told.mean, told.cov.variances())]

    (mean, variance), (single, single_variance) = found(jnp.float64), found(jnp.float32)
    late = slice(100, None)  # the first readings lower the velocity's variance by eight digits
    assert np.max(np.abs(single_variance / variance - 1.0)[late]) < 1e-2
    assert np.max(np.abs(single - mean) / np.sqrt(variance)) < 1e-2


def test_a_gpu_computes_all_recordings_at_once(monkeypatch):
    problem, loops = foot(100, 20, jnp.float32), {}
    for on in ("cpu", "cuda"):
        monkeypatch.setattr(batch, "backend", lambda on=on: on)
        traced = jax.jit(lambda of: smoother(problem, of, problem.logs)).trace(problem.batch)
        loops[on] = traced.lower(lowering_platforms=(on,)).as_text().count("stablehlo.while")
    assert loops["cuda"] == loops["cpu"] - 1 >= 2  # forward and backward in time, without the loop over blocks


def test_student_s_t_is_that_of_the_innovation_s_covariance():
    rng = np.random.default_rng(3)
    errors, root = rng.normal(size=(6, 2)), np.array([[0.5, 0.0], [0.2, 0.3]])
    cov = root @ root.T
    nis = np.sum(np.linalg.solve(root, errors.T) ** 2, axis=0)
    normal = stats.multivariate_normal([0.0, 0.0], cov).logpdf(errors)
    told = Posterior(log_likelihood=jnp.asarray(normal), nis=jnp.asarray(nis), count=jnp.full(6, 2.0))
    np.testing.assert_allclose(told.student_t(4.0), stats.multivariate_t([0.0, 0.0], cov, df=4.0).logpdf(errors))
    np.testing.assert_allclose(told.student_t(1e7), normal, rtol=1e-5)
    masked = Posterior(log_likelihood=jnp.zeros(1), nis=jnp.zeros(1), count=jnp.zeros(1))
    np.testing.assert_allclose(masked.student_t(4.0), 0.0, atol=1e-12)
