"""What a model states of its errors is the derivative of its functions, and both executions use it alike."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering import problems

from jgait import filtering
from jgait.estimators.foot_ins import model as fm
from jgait.filtering import IteratedEKF
from jgait.geometry.rotation import Quaternion, conjugate, rotated
from jgait.geometry.vectors import GRAVITY, Vector

DT = 0.01
PARAMS = fm.FootModelParams(0.08, 1e-8, 1e-6, 1e-4)
STATED = fm.MODEL
FOUND = STATED._replace(error_transition=None, error_observation=None, error_shift=None)
"""The same model, whose errors move as `retract` and `local` say."""


class Walk(NamedTuple):
    """A foot's signals over time."""

    observations: Any
    controls: Any
    mask: Any


def walk(samples: int, seed: int = 0, noise: float = 1.0) -> Walk:
    """Steps of a second: the foot stands for 0.4 s, then swings through 1.3 m and pitches; biased, noisy sensors."""
    rng = np.random.default_rng(seed)
    time = DT * np.arange(1.0, samples + 1.0)
    phase = (time % 1.0 - 0.4) / 0.6
    swings = phase > 0.0
    s = np.where(swings, np.sin(np.pi * phase) ** 2, 0.0)
    pitch = np.where(swings, 0.9 * np.sin(2.0 * np.pi * phase) * np.sin(np.pi * phase) ** 2, 0.0)
    rate = np.gradient(pitch, DT)
    forward = np.where(swings, 1.3 * 2.0 * np.pi * np.sin(2.0 * np.pi * phase) / 0.36, 0.0)
    up = GRAVITY + np.where(swings, 3.0 * np.cos(2.0 * np.pi * phase), 0.0)
    q = Quaternion(np.cos(0.5 * pitch), 0.0 * pitch, np.sin(0.5 * pitch), 0.0 * pitch)
    acc = rotated(conjugate(q), Vector(forward, 0.0 * up, up))
    gyr = Vector(0.3 * s, rate, -0.2 * s)

    def read(clean: Vector, sigma: float, biases: tuple[float, ...]) -> Vector:
        noisy = (c + noise * (b + sigma * rng.normal(size=samples)) for c, b in zip(clean, biases, strict=True))
        return Vector(*map(jnp.asarray, noisy))

    full = np.ones(samples)
    controls = fm.FootControl(
        read(gyr, 0.02, (0.01, -0.02, 0.015)), read(acc, 0.2, (0.05, -0.03, 0.02)),
        jnp.asarray(full * 4e-6), jnp.asarray(full * 4e-4), jnp.asarray(full * 1e-4),
        jnp.asarray((np.arange(samples) % 100 == 20) * 1.0),
    )  # fmt: skip
    zero = jnp.zeros(samples)
    return Walk(fm.FootObservation(Vector(zero, zero, zero), zero), controls, jnp.asarray(~swings))


def vector(tree: Any) -> Any:
    return jnp.stack([jnp.asarray(leaf, float) for leaf in jax.tree.leaves(tree)])


def errors_at(seed: int) -> tuple[fm.FootState, fm.FootControl, fm.FootError]:
    """A state, a control and an error like those of a swinging foot, and a zero error's type."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    three = lambda size: Vector(*map(jnp.asarray, size * rng.normal(size=3)))  # noqa: E731
    state = fm.FootState(three(0.5), three(1.0), Quaternion(*map(jnp.asarray, q)), three(0.02), three(0.1))
    control = fm.FootControl(three(5.0), three(20.0), 1e-6, 1e-4, 1e-4, jnp.asarray(rng.integers(2) * 1.0))
    return state, control, fm.FootError(three(0.1), three(0.1), three(0.3), three(0.01), three(0.1))


@pytest.mark.parametrize("seed", range(4))
def test_stated_errors_are_the_derivatives_of_the_functions(seed):
    state, control, delta = errors_at(seed)
    like = jax.tree.structure(delta)
    after = fm.transition(PARAMS, state, control, DT)

    def found(error: Any) -> Any:
        return vector(fm.local(after, fm.transition(PARAMS, fm.retract(state, like.unflatten(error)), control, DT)))

    def stated(error: Any) -> Any:
        e = like.unflatten(error)
        for step in STATED.error_transition:
            e = step(PARAMS, state, e, control, DT)
        return vector(e)

    zero = jnp.zeros(15)
    # The turn within an interval, here up to 0.1 rad, enters as a series to its second power.
    np.testing.assert_allclose(jax.jacfwd(stated)(zero), jax.jacfwd(found)(zero), rtol=0, atol=1e-8)
    shown = jax.jacfwd(lambda e: vector(fm.error_observation(PARAMS, state, like.unflatten(e), control)))(zero)
    truth = jax.jacfwd(lambda e: vector(fm.observation(PARAMS, fm.retract(state, like.unflatten(e)), control)))(zero)
    np.testing.assert_allclose(shown, truth, rtol=0, atol=1e-12)
    beside = fm.retract(state, delta)
    shifted = jax.jacfwd(lambda e: vector(fm.error_shift(state, delta, like.unflatten(e))))(zero)
    truth = jax.jacfwd(lambda d: vector(fm.local(beside, fm.retract(state, like.unflatten(d)))))(vector(delta))
    np.testing.assert_allclose(shifted, truth, rtol=0, atol=1e-6)


def filtered(model: Any, w: Walk) -> Any:
    def run(w: Walk) -> Any:
        return filtering.kalman_filter(
            model, PARAMS, w.observations, controls=w.controls, dt=DT, mask=w.mask, keep=("mean", "cov")
        )

    return jax.jit(run)(w)


def close(ours: Any, theirs: Any, tolerance: float) -> None:
    """Means to the tolerance, entries of covariances to it beside the standard deviations."""
    for a, b in zip(jax.tree.leaves(ours.mean), jax.tree.leaves(theirs.mean), strict=True):
        np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance)
    a, b = np.asarray(ours.cov.dense(), float), np.asarray(theirs.cov.dense(), float)
    scale = np.sqrt(np.einsum("tii->ti", b))
    np.testing.assert_allclose(a / scale[:, None] / scale[:, :, None], b / scale[:, None] / scale[:, :, None],
                               rtol=0, atol=tolerance)  # fmt: skip


def test_a_filter_is_the_same_whether_errors_are_stated_or_derived():
    w = walk(120)
    close(filtered(STATED, w), filtered(FOUND, w), 1e-6)


def test_iterated_updates_take_the_statement_where_it_holds():
    """Away from the prediction, where the second linearisation is, a heading's errors move otherwise than stated."""
    stated, found = (problems.filtered(problems.case(name), method=IteratedEKF(2)) for name in ("stated", "heading"))
    problems.same(stated, found)


def test_a_flat_model_states_nothing_of_its_errors():
    flat = FOUND._replace(retract=None, local=None, error_shift=fm.error_shift)
    with pytest.raises(ValueError, match="states how errors move gives retract and local"):
        filtered(flat, walk(3))
