"""The profile of a loss: one parameter is held at a list of values, and the others are fitted for each value."""

import math
from collections.abc import Callable
from statistics import NormalDist
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
import optax
from jaxtyping import Array, Float, PyTree

from jgait.notes import record
from jgait.params import Transform, real
from jgait.tune.checks import check_data
from jgait.tune.descent import Settings, descend, lane, norm
from jgait.tune.optimizers import supported
from jgait.tune.problem import Context, Items, Problem, coordinates, natural, place
from jgait.tune.remainder import loss_type, reduced


@record
class Profile(NamedTuple):
    """A profiled parameter."""

    name: str  #: name of the number, such as "thigh_length.right".
    values: np.ndarray  #: (V,) at which the number was held, natural units, ascending.
    #: (V,) total loss of the best fit of the other numbers [nat]; infinite where no loss was finite.
    losses: np.ndarray
    #: fitted parameters, natural units, leading axis (V,) in free leaves; a fixed one is the object given.
    params: PyTree
    #: (V,) of the total loss in the other free coordinates; large where `steps` is too small.
    gradient_norms: np.ndarray
    transform: Transform  #: transform of the number.

    @property
    def rises(self) -> np.ndarray:
        """(V,) each loss minus the profile's minimum [nat]; the minimum may lie between two values."""
        return self.losses - self._minimum()[1]

    def _minimum(self) -> tuple[float, float]:
        """The minimum's free coordinate and loss, from the parabola through the three lowest neighbouring values."""
        free, losses = _free(self.transform, self.values), self.losses
        k = int(np.argmin(losses))
        near = slice(max(k - 1, 0), k + 2)
        if len(free[near]) == 3 and np.isfinite(losses[near]).all():
            bend, slope, level = np.polyfit(free[near] - free[k], losses[near] - losses[k], 2)
            if bend > 0.0:
                return float(free[k] - slope / (2.0 * bend)), float(losses[k] + level - slope**2 / (4.0 * bend))
        return float(free[k]), float(losses[k])

    def _roots(self) -> tuple[np.ndarray, np.ndarray]:
        """Free coordinates of the finite values and of the minimum, ascending, and √(ℓ − min ℓ), negative before it."""
        centre, lowest = self._minimum()
        finite = np.isfinite(self.losses)
        free = np.append(_free(self.transform, self.values)[finite], centre)
        roots = np.sign(free - centre) * np.sqrt(np.maximum(np.append(self.losses[finite], lowest) - lowest, 0.0))
        order = np.argsort(free, kind="stable")
        return free[order], roots[order]

    def curve(self, points: int = 200) -> tuple[np.ndarray, np.ndarray]:
        """The profile between its finite values, as `interval` uses it: values (points,) and rises (points,) [nat]."""
        free, roots = self._roots()
        dense = np.linspace(free[0], free[-1], points)
        return _natural(self.transform, dense), np.interp(dense, free, roots) ** 2

    def interval(self, level: float = 0.95) -> tuple[float | None, float | None]:
        """The interval of values that a likelihood-ratio test at `level` does not reject, in natural units.

        2 (ℓ(x) − min ℓ) ≤ χ²₁(level); between values, √(ℓ − min ℓ) is interpolated linearly in free coordinates, which
        is exact for a parabola. An end is None where the profile does not rise enough within its values, and the last
        value with a finite loss before those without one.

        Raises:
            ValueError: if `level` is not in (0, 1).
        """
        if not 0.0 < level < 1.0:
            raise ValueError(f"level must lie in (0, 1); got {level}")
        height = NormalDist().inv_cdf(0.5 + level / 2.0) / math.sqrt(2.0)
        free, roots = self._roots()

        def end(side: int, outermost: float) -> float | None:
            beyond, rises = side * free, np.maximum.accumulate((side * roots)[::side])  # where it falls again, held
            if rises[-1] >= height:
                at = side * float(np.interp(height, rises, beyond[::side]))
            elif side * outermost > beyond.max():
                at = side * float(beyond.max())
            else:
                return None
            return float(_natural(self.transform, at))

        ends = _free(self.transform, self.values[[0, -1]])
        return end(-1, ends[0]), end(1, ends[1])


def _free(transform: Transform, values: npt.ArrayLike) -> np.ndarray:
    assert transform.to_free is not None
    return np.asarray(transform.to_free(jnp.asarray(values)), float)


def _natural(transform: Transform, free: npt.ArrayLike) -> np.ndarray:
    assert transform.to_natural is not None
    return np.asarray(transform.to_natural(jnp.asarray(free)), float)


class _Held(NamedTuple):
    """The free numbers in two parts: those that are fitted, and the one that is held."""

    others: PyTree
    value: PyTree


def profile(
    loss: Callable[[PyTree, PyTree], PyTree], params: PyTree, transforms: PyTree, data: PyTree, name: str,
    values: npt.ArrayLike, optimizer: optax.GradientTransformation | optax.MultiSteps, *, steps: int = 100,
) -> Profile:  # fmt: skip
    """The loss with one parameter held at each value in turn and all other free parameters fitted.

    A profile needs no curvature; unlike a standard error it shows intervals that are not symmetric or have no end. One
    program fits all values in parallel, as `fit` does, each from `params`, which should be the best parameters. Loss,
    parameters and data are as of `identifiability`; `name` is one of `Identifiability.names`, `values` (V,) are those
    at which this number is held, in natural units, and the optimizer, from optax, takes `steps` steps for each.

    Raises:
        TypeError: if `params` and `transforms` do not match, or `data` holds anything but numbers.
        ValueError: if the name is not that of a free number, a value is outside its range, the loss is not one scalar,
            or it is finite at no value.
    """
    if steps < 1:
        raise ValueError(f"steps must be at least 1; got {steps}")
    at = coordinates(params, transforms)
    if name not in at.names:
        raise ValueError(f"name must be one of the free numbers {', '.join(at.names)}; got {name!r}")
    number = at.names.index(name)
    transform, held = at.transforms[number], np.sort(np.asarray(values, float).ravel())
    if held.size < 2 or np.any(np.diff(held) == 0.0):
        raise ValueError(f"values must be two different numbers at least; got {values!r}")
    if not np.all((held > transform.low) & (held < transform.high) & np.isfinite(held)):
        raise ValueError(f"values of '{name}' must lie in ({transform.low:g}, {transform.high:g}); got {values!r}")
    data, count = check_data(data, True)
    known, items, _ = reduced(Problem(loss, transforms), params, at.tree, Items(data, np.zeros(count, np.int32)))

    def whole(part: _Held) -> Float[Array, "free"]:
        return jnp.concatenate([part.others[:number], part.value[None], part.others[number:]])

    def of_others(part: _Held, item: PyTree) -> PyTree:
        fixed = part._replace(value=jax.lax.stop_gradient(part.value))
        return known.loss(natural(at, whole(fixed), transforms, params), item)

    others = jnp.delete(at.vector, number)
    start = _Held(jnp.tile(others, (len(held), 1)), jnp.asarray(_free(transform, held), at.vector.dtype))
    problem, single = Problem(of_others, _Held(real, real)), lane(start, 0)
    carry, trace = descend(
        problem, supported(optimizer), Settings(steps), Context(single, place(problem, items)), start,
        np.ones((len(held), count)), loss_type(problem, single, items),
    )  # fmt: skip
    if not np.array_equal(carry.best.value, start.value):
        raise ValueError("the optimizer must leave a number as it is whose gradient is 0, without a decay of weights")
    finite = (carry.weights > 0.0).all(axis=1) & np.isfinite(carry.best_score)
    if not finite.any():
        raise ValueError(f"the loss or its gradient is not finite at any of the values of '{name}'")
    norms = np.append(trace.norm, jax.vmap(norm)(carry.gradient)[:, None], axis=1)
    slopes = norms[np.arange(len(held)), np.minimum(carry.best_step, norms.shape[1] - 1)]
    fits = natural(at, jax.vmap(whole)(carry.best), transforms, params)
    losses = np.where(finite, count * carry.best_score, np.inf)
    return Profile(name, held, losses, fits, count * slopes, transform)
