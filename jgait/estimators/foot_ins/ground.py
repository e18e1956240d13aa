r"""Whether the ground is level, stride by stride: its grade is a hidden Markov chain, observed by the rises of strides.

A stride of length L goes over ground of grade g, one of `GRADES`: level, a slope, or stairs. The grade seldom changes.
The rise r of the stride has one of two errors, a usual one or, in a share `BAD` of strides, one of an accelerometer
that clips:

    p(r | g) = (1 − BAD) N(r; g L, σ² + ROLL² + (SPREAD g L)²) + BAD N(r; g L, σ² + … + (FAR max(L, 1 m))²).

So a few bad rises are improbable strides on level ground, and do not make it a slope. The ground below a stride is
level where that is the most probable grade given the rises of all strides, by the forward and backward recursions.

A standing foot that rolls moves its sensor up or down by the distance from the sensor to the point below which it
rolls: 5 cm forward change the rise of every stride by 2 cm. So strides rise by an error that is the same in a whole
walk, and a slope of less than half the lowest grade counts as level.

Source: this library; the recursions after L. R. Rabiner, "A tutorial on hidden Markov models", Proc. IEEE 77(2), 1989.
"""

import numpy as np
from jax import lax

from jgait.geometry.arrays import of_jax, xp
from jgait.types import Flags, Values

GRADES = (0.0, 0.05, -0.05, 0.09, -0.09, 0.13, -0.13, 0.55, -0.55)
"""[1] Rise over length: level ground, slopes up to the steepest for wheelchairs and prams, stairs."""

USUAL = np.array([0.8, *(0.1 / 6.0,) * 6, 0.05, 0.05])
"""[1] Share of the strides on each grade."""

CHANGES = 0.03
"""[1] Probability that the grade is drawn anew between two strides."""

ROLL, SPREAD = 0.02, 0.25
"""[m] Standard deviation of the error that is common to all strides; in the level corridor of `ipol_gait` it is 1.2 cm
(median of 72 feet of 12 people), below 3 cm in 97 % of them. [1] Relative deviation of a grade from its entry."""

BAD, FAR = 0.1, 0.12
"""[1] Share of strides with a bad rise. [1] Deviation of such a rise over the stride's length, of 1 m at least."""

LEAST_LIKELIHOOD = 1e-9
"""[1/m] Least likelihood of a grade."""


def level(rise: Values, length: Values, stddev: Values, valid: Flags) -> Flags:
    """(n,) bool, whether the ground below each stride is level, from its rise, length and their deviation [m].

    Strides that are not `valid` do not count; the ground below them is taken as level.
    """
    grades = xp.asarray(GRADES, length.dtype)
    rise, length, stddev = (values[:, None] for values in (rise, length, stddev))
    ideal = grades[None, :] * length
    off = rise - ideal
    good = stddev**2 + ROLL**2 + (SPREAD * ideal) ** 2
    parts = [(1.0 - BAD, good), (BAD, good + (FAR * xp.maximum(length, 1.0)) ** 2)]
    likelihood = xp.where(
        valid[:, None], sum(share / xp.sqrt(v) * xp.exp(-0.5 * off**2 / v) for share, v in parts), 1.0
    )
    # ground of no grade, such as a fall, does not decide
    likelihood = likelihood + LEAST_LIKELIHOOD
    usual = xp.asarray(USUAL, likelihood.dtype)
    before, after = _messages(likelihood, valid, usual), _messages(likelihood[::-1], valid[::-1], usual)[::-1]
    return (xp.argmax(likelihood * before * after / usual[None, :], axis=1) == 0) | ~valid


def _messages(likelihood: Values, valid: Flags, usual: Values) -> Values:
    """(n, grades) probability of each grade given the strides before; the chain is the same in both directions."""

    def step(before: Values, row: tuple[Values, Flags]) -> tuple[Values, Values]:
        here, counts = row
        now = before * here
        return xp.where(counts, (1.0 - CHANGES) * now / xp.sum(now) + CHANGES * usual, before), before

    if of_jax(likelihood, usual):
        return lax.scan(step, usual, (likelihood, valid))[1]
    message, messages = usual, np.empty_like(likelihood)
    for k in np.flatnonzero(valid):
        message, messages[k] = step(message, (likelihood[k], True))
    return messages
