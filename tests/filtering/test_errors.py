"""What a model states of its errors is the derivative of its functions."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering import problems

from jgait.estimators.foot_ins import model as fm
from jgait.geometry.rotation import Quaternion
from jgait.geometry.vectors import Vector

DT = 0.01
PARAMS = fm.FootModelParams(0.08, 1e-8, 1e-6, 1e-4)
STATED = fm.MODEL


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


def test_a_flat_model_states_nothing_of_its_errors():
    flat = problems.STATED._replace(retract=None, local=None)
    with pytest.raises(ValueError, match="states how errors move gives retract and local"):
        problems.filtered(problems.case("stated")._replace(model=flat))
