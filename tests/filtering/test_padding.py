"""Padding and segments change nothing, and outputs that nobody uses are not computed."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering.problems import SAMPLES, Case, case, padded, same, smoothed

from jgait.filtering import EKF, FIELDS
from jgait.filtering.inputs import checked
from jgait.filtering.scan import Recorded


def result(c: Case) -> Any:
    """All fields of the filter, and the smoother's states and covariances."""
    found = smoothed(c, keep=FIELDS)
    return found.filtered, found.mean, found.cov


@pytest.mark.parametrize("name", ["bent", "heading"])
def test_samples_before_the_padding_are_as_without_it(name):
    c = case(name)
    short, long = result(c), jax.tree.map(lambda v: np.asarray(v)[:SAMPLES], result(padded(c)))
    same(long, short, 1e-13)


@pytest.mark.parametrize(("name", "segment"), [("bent", 5), ("heading", 4), ("heading", 16)])
def test_segments_of_a_long_recording_give_what_one_does(name, segment):
    c = padded(case(name))
    given = checked(c.model, c.params, c.observations, c.controls, c.dt, c.mask, None)
    whole = Recorded(given.shape, EKF(), ("x", "delta", "move", "smoothed"), tuple(range(given.shape.error.size)))
    one, several = (
        jax.jit(function.value)(*(value[..., None] for value in given.arrays()))
        for function in (whole, dataclasses.replace(whole, segment=segment))
    )
    same(several, one, 1e-12)


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
