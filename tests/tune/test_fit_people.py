"""Fits with what labs have: several people, several starts, a validation part, priors, bad recordings, power cuts."""

import sys
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from made.people import OWN, PEOPLE, READINGS, START, Leg, likelihood

from experiments.tuning import killed
from jgait import evaluate, io, params, tune
from jgait.estimators import leg_ekf
from jgait.params import fixed, interval, normal, per_subject, positive, real
from jgait.types import RecordingError

OWN_MEANS = [READINGS[[i for i, one in enumerate(PEOPLE) if one == name]].mean() for name in ("ann", "bob", "cy")]


def test_shared_noise_and_own_lengths_in_one_fit():
    fit = tune.fit(likelihood, START, OWN, READINGS, optax.lbfgs(), steps=30, subjects=PEOPLE)
    assert fit.subjects == ("ann", "bob", "cy")
    np.testing.assert_allclose(fit.params.length, OWN_MEANS, rtol=1e-6)
    residual = READINGS - np.array([dict(zip(fit.subjects, OWN_MEANS, strict=True))[name] for name in PEOPLE])[:, None]
    assert float(fit.params.noise) == pytest.approx(np.mean(residual**2), rel=1e-5)


def test_the_values_of_one_person_are_parameters_of_their_own(tmp_path):
    """They are written, read and used; those of all people together are refused in words."""
    usual = leg_ekf.estimator()
    fit = tune.fit(
        lambda p, item: jnp.mean((item - p.distance_scale) ** 2) + p.rollover_radius**2, usual.params,
        params.freed(usual.transforms, "rollover_radius")._replace(distance_scale=per_subject(positive)),
        READINGS + 0.5, optax.lbfgs(), steps=30, subjects=PEOPLE,
    )  # fmt: skip
    bob = fit.of(" BOB ")
    assert float(bob.distance_scale) == pytest.approx(OWN_MEANS[1] + 0.5, rel=1e-4)
    assert float(bob.rollover_radius) == pytest.approx(float(fit.params.rollover_radius))
    read, _ = io.read_params(io.write_params(tmp_path / "bob.json", bob, estimator="leg_ekf"), usual.params,
                             estimator="leg_ekf")  # fmt: skip
    assert read.distance_scale == pytest.approx(float(bob.distance_scale))
    with pytest.raises(KeyError, match="no subject 'dee'; it has ann, bob, cy"):
        fit.of("dee")
    every = io.write_params(tmp_path / "all.json", fit.params, estimator="leg_ekf")
    with pytest.raises(RecordingError, match=r"write those of one person, fit\.of\(subject\)"):
        io.read_params(every, usual.params, estimator="leg_ekf")
    with pytest.raises(ValueError, match=r"'distance_scale' has the shape \(3,\).*fit\.of\(subject\)"):
        evaluate.cohort(usual, [], fit.params)


def test_priors_weigh_like_one_more_reading():
    """With a normal prior and known variance the optimum is the precision-weighted mean."""
    variance, mean, stddev = 0.01, 0.6, 0.02
    free = Leg(per_subject(real), fixed, fixed)

    def nats(p, item):
        return 0.5 * jnp.sum((item - p.length) ** 2) / variance

    fit = tune.fit(
        nats, START, free, READINGS, optax.lbfgs(), steps=30, subjects=PEOPLE,
        priors=Leg(normal(mean, stddev), None, None),
    )  # fmt: skip
    precision, prior = 80 / variance, 1.0 / stddev**2
    expected = [(precision * m + prior * mean) / (precision + prior) for m in OWN_MEANS]
    np.testing.assert_allclose(fit.params.length, expected, rtol=1e-6)


class Spot(NamedTuple):
    x: Any


def wells(p, item):
    """Two minima, the deeper at 2."""
    return item * ((p.x**2 - 4.0) ** 2 / 8.0 - 0.5 * p.x)


def test_several_starts_find_the_deeper_well():
    alone = tune.fit(wells, Spot(-2.0), Spot(real), np.ones(2), optax.adam(0.05), steps=200)
    several = tune.fit(
        wells, Spot(-2.0), Spot(real), np.ones(2), optax.adam(0.05), steps=200, starts=8, spread=3.0,
        key=jax.random.key(1),
    )  # fmt: skip
    assert float(alone.params.x) < 0.0
    assert float(several.params.x) > 1.9
    assert several.best_loss < alone.best_loss


def bowl(p, item):
    return (p.x - item) ** 2


def test_validation_chooses_the_best_and_patience_stops():
    data = np.array([4.0, 4.0, 1.0, 1.0])  # learning goes to 4 and passes what is judged by at 1
    hold = np.array([False, False, True, True])
    fit = tune.fit(
        bowl, Spot(0.0), Spot(real), data, optax.sgd(0.02), steps=200, validation=hold, patience=5,
    )  # fmt: skip
    assert float(fit.params.x) == pytest.approx(1.0, abs=0.08)
    assert fit.losses.size == int(np.argmin(fit.validation)) + 1 + 5
    assert fit.best_loss == np.min(fit.validation)


def test_minibatches_go_through_every_item_in_every_epoch_and_find_the_mean():
    data = np.arange(10.0)
    fit = tune.fit(
        bowl, Spot(0.0), Spot(real), data, optax.sgd(optax.exponential_decay(0.2, 50, 0.5)), steps=600, minibatch=3,
        key=jax.random.key(0),
    )  # fmt: skip
    assert float(fit.params.x) == pytest.approx(4.5, abs=0.05)
    looks = np.flatnonzero(np.isfinite(fit.validation))
    assert np.array_equal(looks[:3], [3, 7, 11])  # once an epoch of 4 steps
    assert fit.best_loss == pytest.approx(np.mean((data - float(fit.params.x)) ** 2), rel=1e-12)
    whole = tune.fit(bowl, Spot(0.0), Spot(real), data, optax.sgd(0.1), steps=5, minibatch=10, key=jax.random.key(0))
    full = tune.fit(bowl, Spot(0.0), Spot(real), data, optax.sgd(0.1), steps=5)
    np.testing.assert_allclose(whole.losses, full.losses, rtol=1e-12)


@pytest.mark.parametrize("minibatch", [None, 2])
def test_an_item_that_cannot_be_computed_is_left_out_and_named(minibatch):
    data = np.array([1.0, np.nan, 2.0, 3.0])
    options = {"minibatch": minibatch, "key": jax.random.key(0)}
    with pytest.warns(UserWarning, match=r"1 of 4 items were left out.*\(items 1\)"):
        fit = tune.fit(bowl, Spot(0.0), Spot(real), data, optax.sgd(0.05), steps=200, **options)
    clean = tune.fit(bowl, Spot(0.0), Spot(real), data[[0, 2, 3]], optax.sgd(0.05), steps=200, **options)
    assert fit.left_out == (1,)
    assert float(fit.params.x) == pytest.approx(float(clean.params.x), abs=0.0 if minibatch is None else 0.2)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"starts": 3}, "give key="),
        ({"minibatch": 2}, "give key="),
        ({"minibatch": 9, "key": jax.random.key(0)}, "minibatch must be between 1 and the 3 items"),
        ({"starts": 0}, "starts must be at least 1"),
        ({"subjects": ["a", "b"]}, "one label for each of the 3 items; got 2"),
        ({"transforms": Spot(per_subject(real))}, "parameters per subject need subjects"),
        ({"validation": np.ones(3, bool)}, "some True and some False; got bool of shape .3,., 3 True"),
        ({"priors": Spot("narrow")}, "must hold a jgait.params.Prior"),
        (
            {"transforms": Spot(per_subject(real)), "subjects": ["a", "b", "b"], "params": Spot(np.zeros(3))},
            "one for each of 2; got 3",
        ),
    ],
)
def test_misuse_is_refused(change, message):
    call = {"params": Spot(0.0), "transforms": Spot(real), "data": np.ones(3), "optimizer": optax.sgd(0.1), "steps": 2}
    with pytest.raises((ValueError, TypeError), match=message):
        tune.fit(bowl, **(call | change))


# --- power cuts ---


class Cut(Exception):
    pass


def _fit(file=None, report=None, steps=60, rate=0.1, data=READINGS, loss=likelihood):
    return tune.fit(
        loss, START, Leg(per_subject(interval(0.1, 1.0)), positive, fixed), data, optax.adam(rate), steps=steps,
        subjects=PEOPLE, starts=2, minibatch=4, key=jax.random.key(3), checkpoint_file=file, progress=report, chunk=5,
    )  # fmt: skip


def same(a, b):
    pairs = zip(*(map(np.asarray, jax.tree.leaves(fit)) for fit in (a, b)), strict=True)
    return all(np.array_equal(x, y, equal_nan=x.dtype.kind == "f") for x, y in pairs)


def test_stopped_at_any_stretch_and_started_again_it_ends_with_the_same_bits(tmp_path):
    whole = _fit()
    file = tmp_path / "fit.npz"
    draw = np.random.default_rng(0)
    cuts = 0
    while True:
        left = int(draw.integers(1, 5))

        def report(_):
            nonlocal left
            left -= 1
            if left == 0:
                raise Cut

        try:
            found = _fit(file, report)
            break
        except Cut:
            cuts += 1
    assert cuts >= 4
    assert same(found, whole)
    assert same(_fit(file), whole)  # finished: read, not run
    assert [path.name for path in tmp_path.iterdir()] == ["fit.npz"]


@pytest.mark.release
@pytest.mark.skipif(sys.platform == "win32", reason="kills a process by signal")
def test_killed_by_force_it_ends_with_the_same_bits():
    (row,) = killed.rows(quick=True)
    assert row.n == 1 and row.value == 1.0


def test_a_checkpoint_of_another_fit_and_another_file_are_refused(tmp_path):
    file = tmp_path / "fit.npz"
    _fit(file)
    changes = {"optimizer": {"rate": 0.2}, "data": {"data": READINGS + 0.1}, "settings": {"steps": 70}}
    changes["loss"] = {"loss": lambda p, item: 2.0 * likelihood(p, item)}
    for what, change in changes.items():
        with pytest.raises(ValueError, match=f"belongs to another fit: {what} differ"):
            _fit(file, **change)
    file.write_text("a shopping list")
    with pytest.raises(ValueError, match="is no checkpoint of a fit"):
        _fit(file)


@pytest.mark.usefixtures("unchecked")
def test_an_optimiser_that_is_none_is_refused():
    with pytest.raises(TypeError, match=r"optimizer must come from optax, such as optax.adam\(0.05\); got 'adam'"):
        tune.fit(bowl, Spot(0.0), Spot(real), np.ones(2), "adam")
