"""Harmonics of the pelvis of recorded people, which a gait may add to its own waves."""

import jax.numpy as jnp
import numpy as np
from jax import lax

from jgait.geometry.jets import Jet, part, parts, sin_cos, stacked
from jgait.simulate.recorded_pelvis import HARMONICS
from jgait.types import Values

COUNT = len(HARMONICS[0]) // 2
"""[1] Number of harmonics of each motion of the pelvis."""


def harmonics(side: Values, r: Jet) -> Jet:
    """Displacement of the pelvis forward, left and up [m], its yaw, pitch and roll [rad] in higher harmonics: (6, T).

    Motions forward and up and the pitch have the even harmonics of the stride, the others the odd ones.

    Args:
        side: (T,) 1 where the left foot landed last, −1 where the right foot did.
        r: (T,) share of the step.

    Source: lower backs of 13 people; `experiments.people.pelvis` derives the numbers from the recordings.
    """
    numbers = np.arange(1, 2 * COUNT + 1) * np.pi
    sines, cosines = sin_cos(part(r, None) * numbers.reshape((-1,) + (1,) * side.ndim).astype(side.dtype))
    table = jnp.asarray(HARMONICS, side.dtype)

    def summed(rows: Values, which: slice) -> list[Jet]:
        basis = jnp.concatenate([cosines.orders[:, which], sines.orders[:, which]], axis=1)
        return parts(Jet(jnp.einsum("ch,oh...->oc...", rows, basis, precision=lax.Precision.HIGHEST)))

    ahead, up, pitch = summed(table[:3], slice(1, None, 2))
    left, yaw, roll = (one * side for one in summed(table[3:], slice(0, None, 2)))
    return stacked([ahead, left, up, yaw, pitch, roll])
