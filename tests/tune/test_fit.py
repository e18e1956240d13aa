"""Fitting finds what is there to find, keeps its hands off the rest, and says what went wrong."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from made.models import LOCAL_LEVEL, Level, Noise

from jgait import tune
from jgait.filtering import KF, kalman_filter
from jgait.params import fixed, interval, positive, real


class Line(NamedTuple):
    slope: Any
    scale: Any
    share: Any


START = Line(slope=0.5, scale=1.0, share=0.5)
FREE = Line(slope=real, scale=positive, share=interval(0.0, 1.0))


def bowl(params, target):
    """Quadratic with its bottom at `target` (3,)."""
    return (params.slope - target[0]) ** 2 + (params.scale - target[1]) ** 2 + (params.share - target[2]) ** 2


TARGETS = jnp.asarray([[-2.0, 2.0, 0.1], [-4.0, 4.0, 0.3]])


def test_it_finds_the_bottom_of_a_quadratic_averaged_over_the_items():
    fit = tune.fit(bowl, START, FREE, TARGETS, optax.adam(0.1), steps=400)
    np.testing.assert_allclose(np.array(fit.params), [-3.0, 3.0, 0.2], atol=1e-3)
    assert fit.best_loss == pytest.approx(1.0 + 1.0 + 0.01, abs=1e-5)
    assert fit.losses.shape == fit.gradient_norms.shape == fit.accepted.shape == (400,) and fit.accepted.all()
    alone = tune.fit(bowl, START, FREE, TARGETS[0], optax.sgd(1e-3), steps=1, batched=False)
    slopes = [2.0 * (0.5 + 2.0), 2.0 * (1.0 - 2.0) * 1.0, 2.0 * (0.5 - 0.1) * 0.25]  # in free coordinates
    assert alone.gradient_norms[0] == pytest.approx(np.linalg.norm(slopes), rel=1e-12)
    assert float(alone.params.slope) == pytest.approx(0.5 - 1e-3 * slopes[0], rel=1e-12)
    assert fit.losses[0] == pytest.approx(np.mean([float(bowl(START, t)) for t in TARGETS]))


def test_innovation_likelihood_finds_the_noise_variances_that_made_the_data():
    rng = np.random.default_rng(0)
    items, samples = 4, 600
    level = np.cumsum(rng.normal(0.0, np.sqrt(0.05), (items, samples)), axis=1)
    measured = jnp.asarray(level + rng.normal(0.0, np.sqrt(0.4), (items, samples)))

    def loss(params, values):
        posterior = kalman_filter(LOCAL_LEVEL, params, Level(values), method=KF(), dt=1.0, keep=("log_likelihood",))
        return -jnp.mean(posterior.log_likelihood)

    start, free = Noise(1.0, 1.0), Noise(positive, positive)
    fit = tune.fit(loss, start, free, measured, optax.adam(0.1), steps=80)

    def total(logs):  # negative log-likelihood of all that was measured, by the logarithms of the variances
        params = Noise(*jnp.exp(logs))
        return jnp.sum(jax.vmap(loss, in_axes=(None, 0))(params, measured)) * samples

    found = jnp.log(jnp.asarray([fit.params.process, fit.params.sensor]))
    deviation = np.sqrt(np.diag(np.linalg.inv(jax.jit(jax.hessian(total))(found))))  # from the curvature
    assert np.all(deviation < [0.15, 0.05])
    assert np.all(np.abs(found - np.log([0.05, 0.4])) < 6.0 * deviation)
    assert fit.gradient_norms[-1] < 0.02 * fit.gradient_norms[0]
    assert fit.best_loss < fit.losses[0] - 0.1


def test_what_is_fixed_stays_bit_for_bit_and_bounds_hold_even_when_the_optimum_lies_outside():
    scale = np.float64(1.0) / 3.0
    fit = tune.fit(bowl, START._replace(scale=scale), FREE._replace(scale=fixed), TARGETS, optax.adam(0.1), steps=30)
    assert fit.params.scale is scale and fit.free.scale is None and float(fit.params.slope) != 0.5
    fit = tune.fit(bowl, START, FREE, jnp.asarray([[0.0, -5.0, 3.0]]), optax.adam(0.3), steps=200)
    assert 0.0 < float(fit.params.scale) < 0.05 and 0.95 < float(fit.params.share) < 1.0


def test_reporting_progress_in_chunks_changes_no_bit():
    adam = optax.adam(0.1)
    plain = tune.fit(bowl, START, FREE, TARGETS, adam, steps=40)
    for chunk in (1, 7, 40, 100):
        seen: list[tune.Progress] = []
        chunked = tune.fit(bowl, START, FREE, TARGETS, adam, steps=40, chunk=chunk, progress=seen.append)
        for a, b in zip(jax.tree.leaves(plain), jax.tree.leaves(chunked), strict=True):
            assert np.array_equal(np.asarray(a), np.asarray(b), equal_nan=True)
        size = min(max(chunk, 2), 41)
        # The start is evaluated like a step, before the first.
        assert [now.done for now in seen] == [min(d, 41) - 1 for d in range(size, 41 + size, size)]
        assert (seen[-1].done, seen[-1].total) == (40, 40)
        assert seen[-1].score == plain.best_loss
    seen.clear()  # by default some twenty times
    tune.fit(bowl, START, FREE, TARGETS, optax.sgd(0.01), steps=100, progress=seen.append)
    assert [now.done for now in seen] == [*range(4, 100, 5), 100]


def cliff(params, item):
    """Falls towards 1, is not a number beyond it."""
    return item * jnp.where(params.slope < 1.0, (params.slope - 2.0) ** 2, jnp.nan)


def test_a_step_into_the_void_is_taken_back_shortened_and_counted():
    start, only = START._replace(slope=0.0), Line(real, fixed, fixed)
    fit = tune.fit(cliff, start, only, jnp.ones(1), optax.sgd(0.4), steps=30)
    assert not fit.accepted[0] and np.sum(~fit.accepted) > 1
    assert fit.losses[1] == fit.losses[0] == 4.0  # kept where it was
    assert np.isfinite([fit.losses, fit.gradient_norms]).all() and 0.9 < float(fit.params.slope) < 1.0
    with pytest.warns(UserWarning, match="no step lowered the loss.*; 1 of 1 steps led to a loss or a gradient"):
        fit = tune.fit(  # finite at 0, but with an infinite slope there: 0.25 − 0.25 · 1 = 0
            lambda p, item: item * jnp.sqrt(jnp.abs(p.slope)), start._replace(slope=0.25), only, jnp.ones(1),
            optax.sgd(0.25), steps=1,
        )  # fmt: skip
    assert not fit.accepted.any() and float(fit.params.slope) == 0.25


def test_a_rejected_step_leaves_the_optimizers_state_as_it_was():
    """With momentum, a step counted twice would be longer: after one rejection the next is exactly half the first."""
    start, only = START._replace(slope=0.0), Line(real, fixed, fixed)
    momentum = optax.sgd(0.4, momentum=0.9)
    fit = tune.fit(cliff, start, only, jnp.ones(1), momentum, steps=2)
    assert list(fit.accepted) == [False, True]
    assert float(fit.params.slope) == pytest.approx(0.5 * 0.4 * 4.0)


def test_the_best_is_kept_when_the_last_is_worse():
    with pytest.warns(UserWarning, match="no step lowered the loss"):
        fit = tune.fit(bowl, START, FREE, TARGETS, optax.sgd(2.2), steps=15)
    assert fit.best_loss == fit.losses.min() < fit.losses[-1]
    best = float(np.mean([float(bowl(fit.params, t)) for t in TARGETS]))
    assert best == pytest.approx(fit.best_loss, rel=1e-12)


def test_single_precision_stays_single():
    start = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), START)
    fit = tune.fit(bowl, start, FREE, TARGETS.astype(jnp.float32), optax.adam(0.1), steps=5)
    assert fit.params.slope.dtype == jnp.float32
    assert fit.losses.dtype == np.float32


class Other(NamedTuple):
    slope: Any


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"data": ()}, ValueError, "data is empty: there must be at least one array"),
        ({"data": jnp.zeros((0, 3))}, ValueError, "data is empty: its leading axis has no items"),
        (
            {"data": {"a": jnp.ones((2, 3)), "b": jnp.ones(3)}},
            ValueError,
            r"same number of items; got .*'a'.*: 2, .*'b'.*: 3",
        ),
        ({"data": {"a": 1.0}}, ValueError, r"data\['a'\] is a single number; every leaf needs a leading axis"),
        ({"data": {"a": "walk"}}, TypeError, r"data\['a'\] must be an array or a number; got str"),
        ({"transforms": Line(fixed, fixed, fixed)}, ValueError, "every parameter is fixed"),
        ({"transforms": Other(real)}, TypeError, "params and transforms must have the same structure"),
        ({"transforms": Line(real, real, "positive")}, TypeError, "transforms must hold a jgait.params.Transform"),
        ({"params": START._replace(scale=-1.0)}, ValueError, r"'scale' must lie in \(0, inf\); got -1"),
        (
            {"loss": lambda p, item: p.slope * item},
            ValueError,
            r"loss must return one floating-point scalar.*float64\[3\]",
        ),
        ({"loss": lambda p, item: (p.slope, p.scale)}, ValueError, "loss must return one floating-point scalar"),
        ({"loss": lambda p, item: p.slope * jnp.nan * item[0]}, ValueError, "not finite at the start"),
        ({"data": jnp.full((2, 3), jnp.nan)}, ValueError, "data holds no finite number"),
        ({"steps": 0}, ValueError, "steps and chunk must be at least 1; got steps=0"),
    ],
)
def test_misuse_is_refused_by_name(change, error, message):
    call = {"loss": bowl, "params": START, "transforms": FREE, "data": TARGETS, "optimizer": optax.sgd(0.1), "steps": 2}
    with pytest.raises(error, match=message):
        tune.fit(**(call | change))


def test_parameters_that_are_not_learned_are_named_and_a_fit_that_learns_nothing_stops():
    def flat(params, target):
        return (params.slope - target[0]) ** 2 + 0.0 * params.share

    with pytest.warns(UserWarning, match="not learned: share; the gradient is 0"):
        fit = tune.fit(flat, START, FREE._replace(scale=fixed), TARGETS, optax.adam(0.1), steps=3)
    assert float(fit.params.slope) != START.slope and float(fit.params.share) == START.share

    def rounding(params, target):
        return jnp.sum(target**2) + 1e-19 * params.slope

    with pytest.warns(UserWarning, match="not learned: slope; the gradient is 0 at every step, or no more than round"):
        fit = tune.fit(rounding, START, Line(real, fixed, fixed), TARGETS, optax.adam(0.1), steps=40, chunk=4)
    assert fit.losses.shape == (1,)
    only = Line(fixed, fixed, interval(-1e-9, 1.0))
    with pytest.warns(UserWarning, match="not learned: share; the start value lies at an end of the range"):
        tune.fit(bowl, START._replace(share=0.0), only, TARGETS, optax.adam(0.2), steps=12)
    tune.fit(bowl, START._replace(share=1e-2), only, TARGETS, optax.adam(0.2), steps=12)  # warns of nothing


@pytest.mark.parametrize("optimizer", [optax.sgd(5.0), optax.sgd(-0.1), optax.adam(float("nan")), optax.sgd(1e-18)])
def test_it_says_so_when_no_step_lowers_the_loss(optimizer):
    with pytest.warns(UserWarning, match="no step lowered the loss: the start values are the result, with a loss of"):
        fit = tune.fit(bowl, START, FREE, TARGETS, optimizer, steps=12)
    assert fit.best_step == 0 and fit.params == START and fit.best_loss == fit.losses[0]


def test_cross_validation_says_so_when_no_step_lowers_the_loss():
    with pytest.warns(UserWarning, match="no step lowered the loss: the start values are the result"):
        tune.cross_validate(bowl, START, FREE, TARGETS, optax.sgd(5.0), subjects="ab", steps=4)


OPTIMIZERS = {
    "lookahead in a chain": optax.chain(optax.clip(10.0), optax.lookahead(optax.adam(0.1), 5, 0.5, reset_state=True)),
    "several steps": optax.MultiSteps(optax.adam(0.2), 4),
    "noise": optax.chain(optax.add_noise(1e-4, 0.55, key=jax.random.key(0)), optax.adam(0.1)),
    "line search": optax.lbfgs(),
    "plateau": optax.chain(optax.adam(0.1), optax.contrib.reduce_on_plateau(patience=20)),
    "gradient elsewhere": optax.contrib.sam(optax.sgd(0.05), optax.sgd(0.01), opaque_mode=True),
    "a part each": optax.partition({"a": optax.sgd(0.05), "b": optax.adam(0.1)}, Line("a", "b", "b")),
}


@pytest.mark.parametrize("name", OPTIMIZERS)
def test_any_optimiser_of_optax_goes_down_and_goes_on_from_a_checkpoint(name, tmp_path):
    def fit(**more):
        return tune.fit(bowl, START, FREE, TARGETS, OPTIMIZERS[name], steps=60, chunk=20, **more)

    def cut(now):
        if now.done > 30:
            raise InterruptedError

    whole = fit()
    assert whole.best_loss < 0.5 * whole.losses[0] and whole.best_step > 0
    with pytest.raises(InterruptedError):
        fit(checkpoint_file=tmp_path / "fit.npz", progress=cut)
    assert fit(checkpoint_file=tmp_path / "fit.npz").params == whole.params


def test_lookahead_steps_as_optax_shows_it():
    optimizer = optax.lookahead(optax.sgd(0.05), sync_period=3, slow_step_size=0.5)
    free = jnp.asarray(START.slope)
    both = optax.LookaheadParams.init_synced(free)
    state = optimizer.init(both)
    for _ in range(6):
        slope = 2.0 * (both.fast - jnp.mean(TARGETS[:, 0]))
        with jax.numpy_dtype_promotion("standard"):
            change, state = optimizer.update(slope, state, both)
        both = optax.apply_updates(both, change)
    only = Line(real, fixed, fixed)
    fit = tune.fit(bowl, START, only, TARGETS, optimizer, steps=7)
    expected = np.mean([float(bowl(START._replace(slope=both.fast), target)) for target in TARGETS])
    assert fit.losses[6] == pytest.approx(expected, rel=1e-12)


def test_a_parameter_does_not_run_to_the_end_of_its_range_where_the_loss_becomes_zero():
    def loss(p, item):  # as of a filter in which no sample is valid any more
        usable = jnp.isfinite(p) & (p > 0.0)
        return jnp.where(usable, 900.0 + item * jnp.log(jnp.where(usable, p, 1.0)), 0.0)

    for slope in (-1.0, 1.0):
        found = tune.fit(loss, 1.0, positive, np.full(3, slope), optax.sgd(300.0), steps=8)
        assert np.isfinite(found.params) and found.params > 0.0
        assert 0.0 < found.best_loss < 900.0


def test_a_fit_without_an_optimiser_ends_at_the_optimum_within_a_tenth_of_its_standard_error():
    values = np.random.default_rng(0).normal(3.0, 2.0, (50, 20))

    def nats(params, item):
        return jnp.sum(0.5 * ((item - params.slope) / params.scale) ** 2 + jnp.log(params.scale))

    fit = tune.fit(nats, START, Line(real, positive, fixed), values)
    assert fit.losses.size < 30 and (np.diff(fit.losses) <= 0.0).all()  # of the 100 steps allowed
    stderr = values.std() / np.sqrt(values.size)
    assert abs(float(fit.params.slope) - values.mean()) < 0.1 * stderr
    assert abs(float(fit.params.scale) - values.std()) < 0.1 * stderr / np.sqrt(2.0)


def test_a_fit_without_an_optimiser_follows_a_narrow_curved_valley_and_takes_back_what_is_not_finite():
    def valley(params, item):
        return item * ((1.0 - params.slope) ** 2 + 100.0 * (params.scale - params.slope**2) ** 2)

    fit = tune.fit(valley, START._replace(slope=-1.2), Line(real, real, fixed), np.ones(1))
    np.testing.assert_allclose(fit.params[:2], 1.0, atol=1e-5)
    fit = tune.fit(cliff, START._replace(slope=0.0), Line(real, fixed, fixed), jnp.ones(1), steps=30)
    assert not fit.accepted.all() and 0.9 < float(fit.params.slope) < 1.0
    with pytest.raises(ValueError, match="minibatches need an optimizer of optax"):
        tune.fit(bowl, START, FREE, TARGETS, minibatch=1, key=jax.random.key(0))


def test_equal_fits_share_a_program():
    traced: list[None] = []

    def counted(params, target):
        traced.append(None)
        return bowl(params, target)

    def fit(rate):
        return tune.fit(counted, START, FREE._replace(share=interval(0.0, 1.0)), TARGETS, optax.adam(rate), steps=4)

    first = fit(0.1)
    before = len(traced)
    assert fit(0.1).params == first.params
    once = len(traced) - before  # the loss's type is read in each call
    assert once <= 1
    assert fit(0.2).params != first.params and len(traced) > before + 2 * once
