"""Widths, steps and distances between the feet with standard deviations, from the state of both feet."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jgait.estimators.stride_width_ekf.inputs import StrideRows
from jgait.estimators.stride_width_ekf.model import WidthState, between
from jgait.estimators.stride_width_ekf.params import WidthParams
from jgait.filtering import Covariance
from jgait.geometry.vectors import root
from jgait.types import Strides, Values

SHORTEST_LINE = 0.15
"""[m] Shortest stride with a width; the direction of shorter ones is too uncertain as a reference line."""


def with_stddev(read: Callable[[WidthState], Values], states: WidthState, cov: Values) -> tuple[Values, Values]:
    """A scalar function of the state at every moment (N,), and its standard deviation by linearisation, for covariances
    (N, 10, 10).
    """
    value, slope = jax.vmap(jax.value_and_grad(read))(states)
    g = jnp.stack(jax.tree.leaves(slope), axis=-1)
    variance = jnp.sum(g[:, :, None] * cov * g[:, None, :], axis=(1, 2))
    return value, root(variance)


def distances(p: WidthParams, states: WidthState, cov: Covariance) -> dict[str, Any]:
    """The paper's z₁ and z₂ at every moment [m], and standard deviations; at double support, base of support."""
    z1, z1_stddev = with_stddev(lambda state: between(state).across, states, cov.dense())
    z2, z2_stddev = with_stddev(lambda state: between(state).along, states, cov.dense())
    return {
        "z1": z1,
        "z2": z2,
        "z1_stddev": jnp.hypot(z1_stddev, _like(p.offset_noise, z1)),
        "z2_stddev": jnp.hypot(z2_stddev, _like(p.passing_offset_noise, z2)),
    }


def strides(p: WidthParams, rows: StrideRows, states: WidthState, cov: Covariance) -> tuple[Strides, Strides]:
    """Strides of both feet at N moments, and their standard deviations.

    At the end of a stride the state contains the three positions that its width needs: both stances of the foot, and
    the stance of the other foot in between. So the covariance of the state is their joint covariance. `width` is
    negative where the feet cross over; it and `step_length` are NaN unless the other foot has exactly one stance in
    between.
    """
    at, left = rows.moment, rows.side == 1
    ends = jnp.stack(states, axis=1)[at]
    order = jnp.asarray(_EXCHANGED)
    of_foot = WidthState(*jnp.where(left[:, None], ends[:, order], ends).T)
    dense = cov.dense()[at]
    turned = jnp.where(left[:, None, None], dense[:, order][:, :, order], dense)
    length, length_stddev = with_stddev(_length, of_foot, turned)
    line = rows.valid & rows.passed & (length >= SHORTEST_LINE)
    width, width_stddev = with_stddev(_width, of_foot, turned)
    step, step_stddev = with_stddev(_step, of_foot, turned)
    side = jnp.where(left, -1.0, 1.0).astype(width.dtype)
    nothing = jnp.nan
    zero = jnp.zeros_like(width)
    values = Strides(
        rows.side, rows.start, rows.final_contact, rows.end, jnp.where(rows.valid, length, zero),
        jnp.where(line, side * width, nothing), rows.height, rows.valid, rows.standing, rows.standing_end,
        jnp.where(rows.valid, length / jnp.where(rows.valid, rows.standing_end - rows.standing, 1.0), zero),
        rows.turn, step_length=jnp.where(line, step, nothing),
    )  # fmt: skip
    spread = Strides(
        rows.side, zero, zero, zero, jnp.where(rows.valid, length_stddev, zero),
        jnp.where(line, jnp.hypot(width_stddev, _like(p.offset_noise, zero)), zero), zero, rows.valid,
        step_length=jnp.where(line, jnp.hypot(step_stddev, _like(p.passing_offset_noise, zero)), zero),
    )  # fmt: skip
    return values, spread


def _like(value: Values, array: Values) -> Values:
    return jnp.zeros_like(array) + value


_PLACES = {field: number for number, field in enumerate(WidthState._fields)}
_EXCHANGED = tuple(
    _PLACES[f.replace("right", "left") if "right" in f else f.replace("left", "right")] for f in WidthState._fields
)
"""Places of the components with right and left foot exchanged, so that the striding foot is the right one."""


def _line(state: WidthState) -> tuple[Values, Values, Values, Values, Values]:
    """Right stride: its displacement (x, y), its length, and the vector (x, y) from its start to the left stance."""
    x, y = state.moved_x_right, state.moved_y_right
    square = x * x + y * y
    some = square > 0.0
    length = jnp.where(some, jnp.sqrt(jnp.where(some, square, 1.0)), 1e-6)
    other_x = state.x_left - state.moved_x_left - state.x_right + x
    other_y = state.y_left - state.moved_y_left - state.y_right + y
    return x, y, length, other_x, other_y


def _length(state: WidthState) -> Values:
    return _line(state)[2]


def _width(state: WidthState) -> Values:
    x, y, length, other_x, other_y = _line(state)
    return (x * other_y - y * other_x) / length


def _step(state: WidthState) -> Values:
    x, y, length, other_x, other_y = _line(state)
    return (x * other_x + y * other_y) / length
