"""Widths, steps and distances between the feet with standard deviations, from the state of both feet."""

from collections.abc import Callable
from typing import Any

import jax
from jaxtyping import PyTree

from jgait.estimators.programs import compiled
from jgait.estimators.stride_width_ekf.model import WidthState, between
from jgait.estimators.stride_width_ekf.params import WidthParams
from jgait.estimators.stride_width_ekf.prepare import StrideRows
from jgait.estimators.stride_width_ekf.trajectories import SHORTEST_WAY
from jgait.filtering import Covariance
from jgait.geometry.arrays import xp
from jgait.geometry.vectors import root
from jgait.types import Strides, Values


def with_stddev(
    read: Callable[[WidthState], tuple[Values, ...]], states: WidthState, cov: Values
) -> tuple[tuple[Values, ...], list[Values]]:
    """Functions of the state at every moment (N,), and their standard deviations by linearisation, for covariances
    (N, 10, 10).
    """
    values, slopes = compiled(_with_slopes)(states, read=read)
    rows = [xp.stack(list(slope), axis=-1) for slope in slopes]
    return values, [root(xp.sum(g[:, :, None] * cov * g[:, None, :], axis=(1, 2))) for g in rows]


def _with_slopes(states: WidthState, read: Callable[[WidthState], tuple[Values, ...]]) -> PyTree:
    return jax.vmap(lambda state: (read(state), jax.jacrev(read)(state)))(states)


def distances(p: WidthParams, states: WidthState, cov: Covariance) -> dict[str, Any]:
    """The paper's z₁ and z₂ at every moment [m], and standard deviations; at double support, base of support."""
    (z1, z2), spread = with_stddev(between, states, cov.dense())
    z1_stddev, z2_stddev = (
        xp.hypot(*pair) for pair in zip(spread, (p.offset_noise, p.passing_offset_noise), strict=True)
    )
    return {"z1": z1, "z2": z2, "z1_stddev": z1_stddev, "z2_stddev": z2_stddev}


def strides(p: WidthParams, rows: StrideRows, states: WidthState, cov: Covariance) -> tuple[Strides, Strides]:
    """Strides of both feet at N moments, and their standard deviations.

    At the end of a stride the state contains the three positions that its width needs: both stances of the foot, and
    the stance of the other foot in between. So the covariance of the state is their joint covariance. `width` is
    negative where the feet cross over; it and `step_length` are NaN unless the other foot has exactly one stance in
    between.
    """
    at, left = rows.moment, rows.side == 1
    ends = WidthState(*(part[at] for part in states))
    (length, width, step), (length_stddev, width_stddev, step_stddev) = (
        [xp.where(left, of_left, of_right) for of_right, of_left in zip(part[:3], part[3:], strict=True)]
        for part in with_stddev(_of_strides, ends, cov.dense()[at])
    )
    line = rows.valid & rows.passed & (length >= SHORTEST_WAY)
    nothing, zero = xp.nan, xp.zeros_like(width)
    values = Strides(
        rows.side, rows.start, rows.final_contact, rows.end, xp.where(rows.valid, length, zero),
        xp.where(line, width, nothing), rows.height, rows.valid, rows.standing, rows.standing_end,
        xp.where(rows.valid, length / xp.where(rows.valid, rows.standing_end - rows.standing, 1.0), zero),
        rows.turn, step_length=xp.where(line, step, nothing),
    )  # fmt: skip
    deviations = Strides(
        rows.side, zero, zero, zero, xp.where(rows.valid, length_stddev, zero),
        xp.where(line, xp.hypot(width_stddev, p.offset_noise), nothing), zero, rows.valid,
        step_length=xp.where(line, xp.hypot(step_stddev, p.passing_offset_noise), nothing),
    )  # fmt: skip
    return values, deviations


def _of_strides(state: WidthState) -> tuple[Values, ...]:
    """Length, width and step length of a stride of the right foot that ends here, and of one of the left foot."""
    right, left = (state.moved_x_right, state.moved_y_right), (state.moved_x_left, state.moved_y_left)
    # from the start of the right foot's stride to the left foot's stance; its opposite for a stride of the left foot
    x, y = state.apart_x + right[0] - left[0], state.apart_y + right[1] - left[1]
    of_right, (length, width, step) = _measured(*right, x, y), _measured(*left, -x, -y)
    return *of_right, length, -width, step


def _measured(x: Values, y: Values, other_x: Values, other_y: Values) -> tuple[Values, Values, Values]:
    """Length of a stride (x, y), and the way from its start to the other foot's stance to its left, and along it."""
    square = x * x + y * y
    some = square > 0.0
    length = xp.where(some, xp.sqrt(xp.where(some, square, 1.0)), 1e-6)
    return length, (x * other_y - y * other_x) / length, (x * other_x + y * other_y) / length
