"""Scalar components give what the core gives."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from filtering.problems import BENT, SAMPLES, Case, Reading, case, filtered, heading_residual, same, smoothed
from filtering.test_core import WRONG, broken

from jgait import filtering
from jgait.filtering import EKF, KF, UKF, IteratedEKF
from jgait.filtering.fast.scan import SEGMENTED_FROM

EVERY = [("cart", KF(), True), ("cart", EKF(), False), ("bent", EKF(), True), ("leg", EKF(), True),
         ("rates", EKF(), False)]  # fmt: skip


@functools.cache
def core_of(name: str, method: Any) -> Any:
    """The core's smoother of a model as a program of all arrays."""
    model = case(name).model
    return jax.jit(
        lambda *given: smoothed(Case(model, *given), "core", method, keep=filtering.FIELDS, covariance=False)
    )


@pytest.mark.parametrize(("name", "method", "masked"), EVERY)
def test_the_fast_filter_and_smoother_are_the_core(name, method, masked):
    c = case(name, masked=masked)
    fast = smoothed(c, "fast", method, keep=filtering.FIELDS, covariance=False)
    if name == "rates":  # what is never seen is left out
        core = smoothed(c, "core", method, keep=filtering.FIELDS, covariance=False)
    else:  # one program with a mask and without
        mask = jax.tree.map(lambda leaf: np.ones(SAMPLES, bool), c.observations) if c.mask is None else c.mask
        core = core_of(name, method)(*c[1:4], np.broadcast_to(c.dt, SAMPLES), mask)
    same(fast, core)
    assert fast.cov is None


LENGTHS = (289, 293)
"""17², and a prime, whose last segment is filled up."""


def loss_of_means(p: Any, c: Case, weight: Any, execution: str) -> Any:
    return jnp.sum(weight * filtered(c._replace(params=p), execution, keep=("mean",)).mean.position ** 2)


@functools.cache
def core_of_length() -> Any:
    """The core's smoothed means and gradient of the loss; a recording of either length, padded, is an argument."""

    def found(c: Case, weight: Any) -> Any:
        c = c._replace(model=BENT)
        return smoothed(c, "core", covariance=False).mean, jax.grad(loss_of_means)(c.params, c, weight, "core")

    return jax.jit(found)


@pytest.mark.parametrize("samples", LENGTHS)
def test_segments_change_nothing(samples):
    assert samples >= SEGMENTED_FROM
    c = case("bent", samples)
    weight = np.ones(samples)
    arrays = jax.tree.map(lambda v: np.pad(v, (0, max(LENGTHS) - samples)), (*c[2:], weight))
    mean, slope = core_of_length()(Case(None, c.params, *arrays[:-1]), arrays[-1])
    same(smoothed(c, "fast", covariance=False).mean, jax.tree.map(lambda v: np.asarray(v)[:samples], mean))
    for gradient in (jax.grad, jax.jacfwd):
        ours = jax.jit(lambda p, gradient=gradient: gradient(loss_of_means)(p, c, weight, "fast"))(c.params)
        same(ours, slope, 1e-7)


def test_gradients_of_likelihood_and_smoothed_means():
    c = case("bent")

    def slope(p: Any, execution: str) -> Any:
        def loss(p: Any) -> Any:
            found = smoothed(c._replace(params=p), execution, covariance=False)
            return jnp.sum(found.mean.speed**2) - jnp.sum(found.filtered.log_likelihood)

        gradient = jax.grad(loss)(p)
        return gradient, gradient

    core = jax.jit(lambda p: slope(p, "core")[0])
    second, gradient = jax.jit(jax.jacfwd(lambda p: slope(p, "fast"), has_aux=True))(c.params)
    same(gradient, core(c.params), 1e-7)
    moves = 1e-5 * np.eye(4)
    for i in range(3):
        ahead, behind = (np.asarray(core(np.asarray(c.params) + sign * moves[i])) for sign in (1.0, -1.0))
        np.testing.assert_allclose(second[i], (ahead - behind) / 2e-5, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("samples", [SAMPLES, 260])
def test_as_many_recordings_as_samples(samples):
    """A mix-up of the two axes would show in nothing but the numbers."""
    rng = np.random.default_rng(1)
    c = case("bent", samples, masked=False)
    batch = Reading(*(rng.normal(size=(samples, samples)) for _ in range(2)))

    def loss(p: Any, one: Reading, weight: Any) -> Any:
        found = filtered(c._replace(params=p, observations=one), "fast", keep=("mean", "log_likelihood"))
        return jnp.sum(weight * (found.mean.position - found.log_likelihood))

    weight = np.arange(samples, dtype=float) / samples
    ours = jax.jit(jax.vmap(jax.value_and_grad(loss), (None, 0, None)))(c.params, batch, weight)
    ours = jax.tree.map(np.asarray, ours)
    one = jax.jit(jax.value_and_grad(loss))
    for i in (0, samples // 2, samples - 1):
        alone = one(c.params, Reading(batch.near[i], batch.far[i]), weight)
        same((ours[0][i], ours[1][i]), alone, 1e-8)
    whole = jax.jit(jax.grad(lambda p: jnp.sum(jax.vmap(loss, (None, 0, None))(p, batch, weight))))(c.params)
    np.testing.assert_allclose(whole, np.sum(ours[1], axis=0), rtol=1e-8)


@pytest.mark.parametrize("kind", ["observation", "noise"])
def test_a_broken_update_is_the_same_in_both(kind):
    c, _ = broken(kind)
    found = smoothed(c, "fast", keep=filtering.FIELDS, covariance=False)
    np.testing.assert_array_equal(found.filtered.valid, np.arange(SAMPLES) != WRONG)
    same(found, smoothed(c, "core", keep=filtering.FIELDS, covariance=False))


@pytest.mark.parametrize(("name", "method"), [("cart", KF()), ("bent", EKF()), ("leg", EKF())])
def test_measurements_that_are_no_numbers_change_nothing_within_jit(name, method):
    c = case(name, masked=False)
    lost = np.isin(np.arange(SAMPLES), (3, 4, 9))
    observed = jax.tree.map(lambda leaf: jnp.where(lost, jnp.nan, leaf), c.observations)
    found, core = (
        jax.jit(lambda o, execution=execution: filtered(c._replace(observations=o), execution, method=method))(observed)
        for execution in ("fast", "core")
    )
    np.testing.assert_array_equal(found.valid, ~lost)
    same(found, core)
    seen = c._replace(mask=jax.tree.map(lambda leaf: jnp.asarray(~lost), c.observations))
    same(found.cov, filtered(seen, "core", method=method).cov)


NONLINEAR = "the KF needs a linear model.* Jacobian of transition .* depends on the state"


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"execution": "fast", "method": UKF()}, r"KF\(\) and EKF\(\).*this call has the method UKF.* needs 'core'"),
        (
            {"execution": "fast", "method": IteratedEKF(2)},
            r"has the method EKF\(iterations=2, .*\), and needs",
        ),
        ({"execution": "swift"}, "execution must be one of auto, core, fast; got 'swift'"),
        ({"execution": "fast", "method": KF()}, NONLINEAR),
        ({"execution": "core", "method": KF()}, NONLINEAR),
        ({"covariance": "speed"}, "covariance is True, False or a tuple of names; got 'speed'"),
        ({"covariance": ("height",)}, r"covariance names components of the error \(position, speed\); got 'height'"),
    ],
)
def test_what_cannot_be_done_is_refused(more, message):
    with pytest.raises(ValueError, match=message):
        (smoothed if "covariance" in more else filtered)(case("bent"), **more)


def test_a_model_with_a_residual_of_its_own_runs_by_the_core():
    c = case("bent")
    c = c._replace(model=c.model._replace(residual=heading_residual))
    same(filtered(c, "auto").mean, filtered(c, "core").mean, 0.0)
    with pytest.raises(ValueError, match="this call has a residual of its own, and needs 'core'"):
        filtered(c, "fast")


@pytest.mark.parametrize("convert", [list, pd.Series])
def test_lists_and_columns_of_tables_are_refused(convert):
    c = case("bent", masked=False)
    changed = Reading(c.observations.near, convert(np.asarray(c.observations.far).tolist()))
    message = f"must be an array; got a {convert.__name__}: convert it by numpy.asarray"
    with pytest.raises(ValueError, match=f"observation 'far' {message}"):
        filtering.kalman_filter(c.model, c.params, changed, controls=c.controls, dt=0.02)
    with pytest.raises(ValueError, match=f"dt must be a number or an array; got a {convert.__name__}: convert it"):
        filtering.kalman_filter(c.model, c.params, c.observations, controls=c.controls, dt=convert([0.02] * SAMPLES))
    pushed = c.controls._replace(acceleration=convert(np.asarray(c.controls.acceleration).tolist()))
    with pytest.raises(ValueError, match=f"control 'acceleration' {message}"):
        filtering.kalman_filter(c.model, c.params, c.observations, controls=pushed, dt=0.02)


def test_compiled_for_wide_vectors_also_within_another_jit():
    double = filtering.compiled(lambda x, times: x * times, static_argnames=("times",))
    assert float(double(jnp.asarray(2.0), times=3)) == 6.0
    assert float(jax.jit(lambda x: double(x, times=4))(2.0)) == 8.0
    assert float(jax.grad(lambda x: double(x, times=5))(2.0)) == 5.0


@pytest.mark.parametrize("execution", ["core", "fast"])
def test_a_parameter_that_is_nan_has_no_likelihood(execution):
    c = case("bent")
    lost = smoothed(c._replace(params=c.params.at[1].set(jnp.nan)), execution, covariance=False)
    assert np.all(np.isnan(lost.filtered.log_likelihood)) and np.isnan(lost.log_likelihood)
    here = jax.tree.map(lambda leaf: leaf[0], c[2:])
    told = filtering.step(
        c.model, c.params * np.nan, c.model.initial(c.params), here[0], control=here[1], dt=here[2], mask=here[3]
    )
    assert np.isnan(told.log_likelihood)


def test_a_bare_array_and_times_for_intervals_are_refused_with_what_is_expected():
    c = case("bent")
    with pytest.raises(
        ValueError, match=r"observes a Reading of \(near, far\); got a bare array; pass Reading\(near=…"
    ):
        filtered(c._replace(observations=c.observations.near, mask=None))
    times = 0.02 * np.arange(SAMPLES)
    with pytest.raises(ValueError, match=r"dt must be the time since the sample before .*; got times that grow from 0"):
        filtering.kalman_filter(c.model, c.params, c.observations, controls=c.controls, dt=times)
