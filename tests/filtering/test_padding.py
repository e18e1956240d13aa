"""Padding costs nothing and changes nothing, and outputs that nobody uses are not computed."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering.problems import MORE, SAMPLES, Case, case, filtered, padded, same, smoothed

from jgait.filtering import EKF, FIELDS, UKF, IteratedEKF
from jgait.filtering.inputs import inputs
from jgait.filtering.recorded import Recorded


def result(c: Case) -> Any:
    """All fields of the filter, and the smoother's states and covariances."""
    found = smoothed(c, keep=FIELDS)
    return found.filtered, found.mean, found.cov


def at(tree: Any, place: Any) -> Any:
    return jax.tree.map(lambda v: np.asarray(v)[place], tree)


def loss(c: Case, p: Any, weight: Any, derivative: Any = "reverse") -> Any:
    """A number that depends on states, covariances and the likelihood at the samples with a weight."""
    found = smoothed(c._replace(params=p), method=EKF(derivative=derivative))
    parts = (*jax.tree.leaves(found.mean), *jax.tree.leaves(found.cov.variances()), found.filtered.log_likelihood)
    return sum(jnp.sum(weight * part**2) for part in parts)


@pytest.mark.parametrize("name", ["bent", "heading"])
def test_samples_before_the_padding_are_as_without_it_and_the_last_one_lasts(name):
    c = case(name)
    short, long = result(c), at(result(padded(c)), ...)
    same(at(long, slice(SAMPLES)), short, 1e-14)
    for leaf in jax.tree.leaves(long[1:]):
        tail = leaf[SAMPLES:]
        np.testing.assert_allclose(tail, np.broadcast_to(leaf[SAMPLES - 1], tail.shape), rtol=1e-12, atol=1e-14)
    assert np.all(long[0].valid) and not np.any(long[0].count[SAMPLES:]) and not np.any(long[0].nis[SAMPLES:])


@pytest.mark.parametrize(("name", "segment"), [("bent", 5), ("heading", 4), ("heading", 16)])
def test_segments_of_a_long_recording_give_what_one_does(name, segment):
    c = padded(case(name))
    given = inputs(c.model, c.params, c.observations, c.controls, c.dt, c.mask, None)
    whole = Recorded(given.shape, EKF(), ("x", "delta", "move", "smoothed"), tuple(range(given.shape.error.size)))
    one, several = (
        jax.jit(function.value)(*(value[..., None] for value in given.arrays()))
        for function in (whole, dataclasses.replace(whole, segment=segment))
    )
    same(several, one, 1e-12)


@pytest.mark.parametrize("method", [IteratedEKF(2), UKF()])
def test_methods_without_a_closed_form_stop_there_too(method):
    c = case("line")

    def mean(of: Case, p: Any) -> Any:
        return filtered(of._replace(params=p), method=method, keep=("mean", "log_likelihood"))

    long, short = mean(padded(c), c.params), mean(c, c.params)
    same((at(long.mean, slice(SAMPLES)), long.log_likelihood[:SAMPLES]), (short.mean, short.log_likelihood), 1e-13)
    slopes = [jax.jit(jax.grad(lambda p, of=of: jnp.sum(mean(of, p).mean.s[:SAMPLES]))) for of in (padded(c), c)]
    same(*(slope(c.params) for slope in slopes), 1e-11)


@pytest.mark.parametrize("name", ["bent", "heading"])
def test_gradients_of_padded_recordings_agree_in_both_modes(name):
    c = case(name)
    long = padded(c)
    whole = np.cos(np.arange(SAMPLES + MORE))
    direction = np.arange(1.0, 5.0)
    compiled = jax.jit(jax.grad(lambda p, weight: loss(long, p, weight)))
    short = jax.jit(jax.grad(lambda p: loss(c, p, whole[:SAMPLES])))(c.params)
    same(compiled(c.params, np.where(np.arange(SAMPLES + MORE) < SAMPLES, whole, 0.0)), short, 1e-12)
    # A loss on the padding, too: what happens there depends on the last sample.
    along = jax.jit(lambda p: jax.jvp(lambda p: loss(long, p, whole, "forward"), (p,), (direction,))[1])(c.params)
    np.testing.assert_allclose(np.asarray(compiled(c.params, whole)) @ direction, along, rtol=1e-10)


def test_recordings_of_a_batch_have_paddings_of_their_own():
    c = case("heading")
    lengths = (SAMPLES, 5, 1)

    def until(count: int) -> Case:
        here = np.arange(SAMPLES) < count
        return c._replace(dt=np.where(here, c.dt, 0.0), mask=jax.tree.map(lambda v: v & here, at(c.mask, ...)))

    every = [until(count) for count in lengths]
    stacked = jax.tree.map(lambda *v: np.stack(v), *[(e.dt, e.mask) for e in every])
    found = jax.jit(jax.vmap(lambda dt, mask: result(c._replace(dt=dt, mask=mask))))(*stacked)
    for i, one in enumerate(every):
        same(at(found, i), result(one), 1e-12)


@pytest.mark.parametrize("differentiated", [False, True])
def test_covariances_that_are_not_used_are_not_computed(differentiated):
    c = case("heading")

    def operations(covariance: bool) -> float:
        def value(p: Any) -> Any:
            return jnp.sum(smoothed(c._replace(params=p), covariance=covariance).mean.rate)

        function = jax.grad(value) if differentiated else value
        cost: Any = jax.jit(function).lower(c.params).compile().cost_analysis()
        return cost["flops"]

    assert operations(True) == operations(False)
