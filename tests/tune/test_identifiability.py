"""What the data determine is said with the right numbers, and what they do not determine is said by name."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest
from made.models import Gauss, Line, Pair, Z, close, gauss, product, straight

from jgait.params import fixed, interval, normal, positive, real
from jgait.tune.identifiability import identifiability

# --- linear models, where all of it is known ---


SCALE = 0.5
LINE = Line(coefficients=real, scale=fixed)


def regression(count=40, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(count, 3)) * [1.0, 2.0, 0.1] + [0.0, 0.0, 1.0]
    y = x @ [1.0, -2.0, 3.0] + rng.normal(0.0, SCALE, count)
    best = np.linalg.lstsq(x, y)[0]
    return x, y, Line(jnp.asarray(best), SCALE)


def test_a_linear_model_gets_the_covariance_of_least_squares():
    x, y, best = regression()
    found = identifiability(straight, best, LINE, (x, y))
    precision = x.T @ x / SCALE**2
    covariance = np.linalg.inv(precision)
    stderr = np.sqrt(np.diag(covariance))
    assert found.names == ("coefficients[0]", "coefficients[1]", "coefficients[2]")
    assert found.transforms == ("real",) * 3
    close(found.information, precision)
    close(found.covariance, covariance)
    close(found.correlation, covariance / np.outer(stderr, stderr))
    close(found.stderr, stderr)
    close(found.stderr_free, stderr)
    close(found.low, best.coefficients - Z * stderr)
    close(found.high, best.coefficients + Z * stderr)
    assert found.loss == pytest.approx(sum(float(straight(best, item)) for item in zip(x, y, strict=True)))
    assert found.minimum and found.determined.all() and not found.undetermined and not found.directions
    assert np.linalg.norm(found.gradient) < 1e-10 and found.decrement < 1e-20
    close(
        identifiability(straight, best, LINE, (x, y), level=0.5).high, best.coefficients + 0.6744897501960817 * stderr
    )


def test_the_distance_from_the_optimum_is_reported():
    x, y, best = regression()
    off = np.array([0.1, 0.2, -0.3])
    found = identifiability(straight, best._replace(coefficients=best.coefficients + off), LINE, (x, y))
    precision = x.T @ x / SCALE**2
    close(found.gradient, precision @ off, atol=1e-9)
    assert found.decrement == pytest.approx(off @ precision @ off)
    assert any(
        f"no optimum: the gradient asks for a step of {np.sqrt(off @ precision @ off):.2g} standard errors" in s
        for s in found.sentences
    )
    assert not any("no optimum" in s for s in identifiability(straight, best, LINE, (x, y)).sentences)


class Three(NamedTuple):
    slope: Any
    gain: Any
    share: Any


THREE = Three(real, positive, interval(-1.0, 3.0))


def means(params, item):
    """Three means of unit variance, one in each kind of range."""
    return 0.5 * jnp.sum((jnp.stack(list(params)) - item) ** 2)


def test_intervals_are_symmetric_in_free_coordinates_and_stay_within_the_bounds():
    rng = np.random.default_rng(1)
    data = rng.normal(size=(30, 3))
    data += [5.0, 0.3, 2.9] - data.mean(axis=0)
    values = np.array([5.0, 0.3, 2.9])
    found = identifiability(means, Three(*values), THREE, data)
    slopes = np.array([1.0, 0.3, (2.9 + 1.0) * (3.0 - 2.9) / 4.0])
    free = np.array([5.0, np.log(0.3), np.log(3.9 / 0.1)])
    stderr_free = 1.0 / (slopes * np.sqrt(30.0))
    close(found.free, free)
    close(found.values, values)
    close(found.stderr_free, stderr_free)
    close(found.stderr, np.full(3, 1.0 / np.sqrt(30.0)))
    for sign, ends in ((-1.0, found.low), (1.0, found.high)):
        at = free + sign * Z * stderr_free
        close(ends, [at[0], np.exp(at[1]), -1.0 + 4.0 / (1.0 + np.exp(-at[2]))])
    assert found.low[1] > 0.0 and found.high[2] < 3.0
    assert list(found.determined) == [True, True, False]  # 1.9 logits, though the value itself is ± 0.18
    assert found.undetermined == ["share"]
    assert "gain 0.3 within a factor of 1.8" in found.sentences
    assert "slope 5 ± 0.18" in found.sentences
    assert any(s.startswith("share is not determined by these data: its 95 % interval is") for s in found.sentences)
    assert identifiability(means, Three(*values), THREE, data, limit=2.0).determined.all()


# --- what cannot be known ---


def difference(params, item):
    """Sees a1 − rollover_radius only."""
    return 0.5 * ((item - params.a1 + params.rollover_radius) / params.noise) ** 2 + jnp.log(params.noise)


def sample(centre, count=200):
    """Numbers with exactly this mean and a standard deviation of one half."""
    values = np.random.default_rng(3).normal(size=count)
    return centre + 0.5 * (values - values.mean()) / values.std()


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize(
    ("loss", "transform", "centre", "correlation"), [(product, positive, 1.2, -1.0), (difference, real, 0.1, 1.0)]
)
def test_a_pair_of_which_only_one_combination_matters_is_named(loss, transform, centre, correlation, dtype):
    params = Pair(*(jnp.asarray(value, dtype) for value in ((1.5, 0.8, 0.5) if loss is product else (0.9, 0.8, 0.5))))
    data = sample(centre).astype(dtype)
    found = identifiability(loss, params, Pair(transform, transform, positive), data)
    assert found.undetermined == ["a1", "rollover_radius"]
    assert "a1 is not determined by these data: its standard error is infinite" in found.sentences
    assert sum(s.startswith("the combination 0.71 ") for s in found.sentences) == 1
    assert not any(" move " in s for s in found.sentences)  # the combination is named
    assert found.correlation[0, 1] == pytest.approx(correlation, abs=1e-9)
    (one,) = found.directions
    assert set(one.names) == {"a1", "rollover_radius"} and np.isinf(one.stddev)
    close(np.abs(one.weights), [np.sqrt(0.5)] * 2, rtol=1e-4)
    assert np.sign(one.weights[0] * one.weights[1]) == correlation
    assert found.names == Pair._fields
    assert np.isinf(found.stderr[0]) and not found.determined[0]
    # What has nothing to do with the pair is known as well as if there were none: 2 n of information in its logarithm.
    assert found.stderr_free[2] == pytest.approx(np.sqrt(1.0 / 400.0), rel=1e-5 if dtype == np.float32 else 1e-9)
    assert found.determined[2]
    for field in (found.covariance, found.correlation, found.low, found.high):
        assert not np.isnan(field).any()
    assert found.minimum


def test_what_the_loss_never_sees_is_infinite_and_correlated_with_nothing():
    data = sample(1.2)
    found = identifiability(difference, Pair(1.2, 0.0, 0.5), Pair(real, fixed, positive), data)
    blind = identifiability(lambda p, y: difference(p._replace(a1=1.2), y), Pair(1.2, 0.0, 0.5),
                            Pair(real, fixed, positive), data)  # fmt: skip
    assert found.determined.all()
    assert blind.undetermined == ["a1"]
    assert np.isinf(blind.stderr[0]) and blind.low[0] == -np.inf and blind.high[0] == np.inf
    close(blind.correlation, np.eye(2))
    assert blind.stderr[1] == pytest.approx(found.stderr[1])


def test_a_saddle_is_called_no_minimum():
    def loss(params, item):
        return item * (params.a1**2 - params.rollover_radius**2)

    found = identifiability(loss, Pair(0.0, 0.0, 1.0), Pair(real, real, fixed), np.ones(3))
    assert not found.minimum
    assert "the point is no minimum: the loss curves downwards along rollover_radius" in found.sentences
    assert found.undetermined == ["rollover_radius"]
    assert found.stderr[0] == pytest.approx(1.0 / np.sqrt(6.0))
    assert not np.isnan([found.stderr, found.low, found.high, found.stderr_free]).any()


def test_curvature_that_is_not_finite_is_reported_and_no_nan_reaches_the_table():
    def loss(params, item):
        return item * (params.a1**2 + jnp.abs(params.rollover_radius) ** 1.5)

    found = identifiability(loss, Pair(0.0, 0.0, 1.0), Pair(real, real, fixed), np.ones(3))
    assert not np.isfinite(found.information[1, 1])
    assert found.sentences[0] == ("nothing can be said: the derivatives of the loss are not finite at these parameters")
    assert found.undetermined == ["a1", "rollover_radius"] and not found.minimum
    assert np.isinf(found.stderr).all()
    assert not np.isnan([found.stderr, found.low, found.high, found.stderr_free]).any()


# --- other ways to count information ---


def test_the_sandwich_is_the_robust_covariance_of_least_squares_whatever_the_scale_of_the_loss():
    x, y, best = regression()
    y = y + np.abs(x[:, 1]) * np.random.default_rng(5).normal(size=40)  # spread that the loss does not know of
    best = best._replace(coefficients=jnp.asarray(np.linalg.lstsq(x, y)[0]))
    residual = y - x @ np.asarray(best.coefficients)
    bread = np.linalg.inv(x.T @ x)
    robust = bread @ (x.T * residual**2) @ x @ bread
    found = identifiability(straight, best, LINE, (x, y), information="sandwich")
    close(found.covariance, robust)
    close(found.information, x.T @ x / SCALE**2)
    tenth = identifiability(lambda p, item: straight(p, item) / 10.0, best, LINE, (x, y), information="sandwich")
    close(tenth.covariance, robust)
    off = np.array([0.01, 0.0, 0.0])
    moved = identifiability(straight, best._replace(coefficients=best.coefficients + off), LINE, (x, y),
                            information="sandwich")  # fmt: skip
    close(moved.decrement, off @ np.linalg.inv(moved.covariance) @ off, rtol=1e-8)


def test_a_prior_adds_its_precision_once():
    data = np.random.default_rng(6).normal(size=(16, 3))
    priors = Three(None, normal(1.0, 0.1), None)
    at, free = Three(0.0, 1.0, 0.0), Three(real, positive, fixed)
    for information in ("hessian", "sandwich"):
        bare = identifiability(means, at, free, data, information=information)
        told = identifiability(means, at, free, data, information=information, priors=priors)
        close(told.information - bare.information, [[0.0, 0.0], [0.0, 100.0]])  # at 1.0, d ln θ = d θ
    assert told.loss == pytest.approx(bare.loss)
    away = identifiability(means, at._replace(gain=1.2), free, data, priors=priors)
    assert away.loss == pytest.approx(sum(float(means(at._replace(gain=1.2), row)) for row in data) + 2.0)


# --- how it is called ---


class Sides(NamedTuple):
    right: Any
    left: Any


class Leg(NamedTuple):
    thigh_length: Any
    noise: Any
    level: Any


def test_nested_parameters_are_named_as_they_are_written():
    def loss(params, item):
        return item * (jnp.sum(params.level**2) + params.thigh_length.right**2 + params.noise**2)

    params = Leg(Sides(1.0, 2.0), 1.0, jnp.ones((2, 1)))
    found = identifiability(loss, params, Leg(Sides(positive, fixed), real, interval(0.0, 2.0)), np.ones(2))
    assert found.names == ("thigh_length.right", "noise", "level[0, 0]", "level[1, 0]")
    assert found.transforms == ("positive", "real", "interval(0, 2)", "interval(0, 2)")


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"loss": lambda p, y: p.mean * jnp.inf}, ValueError, "the loss is not finite at these parameters"),
        ({"loss": lambda p, y: p.mean * jnp.ones(2)}, ValueError, r"one floating-point scalar.*float64\[2\]"),
        ({"information": "expected"}, ValueError, "hessian, sandwich; got 'expected'"),
        ({"level": 1.0}, ValueError, "level must lie in"),
        ({"limit": 0.0}, ValueError, "limit be positive"),
        (
            {"data": np.ones(2), "information": "sandwich"},
            ValueError,
            "more items, or subjects, than free numbers.*got 2 for 2",
        ),
        ({"priors": (None,)}, TypeError, "priors and transforms must have the same structure"),
        ({"priors": Gauss(None, 3.0)}, TypeError, "Prior or None for every parameter; got 3.0"),
    ],
)
def test_misuse_is_refused_by_name(change, error, message):
    call = {"loss": gauss, "params": Gauss(0.0, 1.0), "transforms": Gauss(real, positive), "data": np.arange(4.0)}
    with pytest.raises(error, match=message):
        identifiability(**(call | change))
