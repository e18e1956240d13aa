"""Sentences about the determination of parameters."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import PyTree

from jgait.notes import resolved
from jgait.params import Transform, positive

LARGE = 0.3
"""Least absolute component of a unit vector at which a direction's name includes the parameter [1]."""

OFF = 0.25
"""Least gᵀ B⁻¹ g at which a point is reported as not an optimum: half a standard error away [1]."""


class Direction(NamedTuple):
    """A combination of parameters in free coordinates."""

    names: tuple[str, ...]  #: names of the parameters with large components.
    weights: tuple[float, ...]  #: those components of the unit vector, the largest positive.
    stddev: float  #: standard deviation along the direction; infinite without information.
    words: str  #: the combination as text, for example "0.71 a1 − 0.71 rollover_radius".


def direction(names: tuple[str, ...], vector: np.ndarray, stddev: float) -> Direction:
    """Describe a unit vector by its large components, or by the largest ones if all are small."""
    vector = vector * (1.0 if vector[np.argmax(np.abs(vector))] > 0.0 else -1.0)
    order = np.argsort(-np.abs(vector), kind="stable")
    large = [int(i) for i in order if abs(vector[i]) >= LARGE] or [int(i) for i in order[:3]]
    words = names[large[0]] if len(large) == 1 else f"{vector[large[0]]:.2f} {names[large[0]]}"
    for i in large[1:]:
        words += f" {'−' if vector[i] < 0.0 else '+'} {abs(vector[i]):.2f} {names[i]}"
    return Direction(tuple(names[i] for i in large), tuple(float(vector[i]) for i in large), stddev, words)


def is_interval(transform: Transform) -> bool:
    """Whether the range has two ends."""
    return math.isfinite(transform.low) and math.isfinite(transform.high)


def is_positive(transform: Transform) -> bool:
    """Whether the free value is the logarithm."""
    return transform.to_free is positive.to_free


def unknown(name: str, transform: Transform, stderr: float, low: float, high: float, level: float) -> str:
    """A sentence stating that a parameter is not determined, with its standard error or interval."""
    sentence = f"{name} is not determined by these data: "
    if math.isinf(stderr):
        return sentence + "its standard error is infinite"
    if is_interval(transform):
        ends = " to ".join(resolved(end, high - low) for end in (low, high))
        return sentence + f"its {100 * level:g} % interval is {ends} of {transform.name}"
    if is_positive(transform):
        factor = f"a factor of {math.exp(stderr):.3g}" if stderr < 14.0 else "more than a factor of a million"
        return sentence + f"its standard error is {factor}"
    return sentence + f"its standard error is {stderr:.3g}"


def known(name: str, transform: Transform, value: float, stderr_free: float, stderr: float) -> str:
    """A sentence stating the value of a parameter and one standard error."""
    if is_positive(transform) and stderr_free >= LARGE:
        return f"{name} {value:.4g} within a factor of {math.exp(stderr_free):.2g}"
    if is_positive(transform):
        return f"{name} {resolved(value, value * stderr_free, 4)} ± {100.0 * stderr_free:.2g} %"
    return f"{name} {resolved(value, stderr, 4)} ± {stderr:.2g}"


def sentences(
    result: PyTree,
    transforms: tuple[Transform, ...],
    together: list[tuple[int, int]],
    falling: list[Direction],
    finite: bool,
    limit: float,
) -> list[str]:
    """The result in sentences: problems, undetermined parameters, correlated parameters, determined parameters.

    `together` has the pairs whose correlation is stated, `falling` the directions along which the loss curves
    downwards; `finite`: all derivatives are.
    """
    lines: list[str] = []
    if not finite:
        lines.append("nothing can be said: the derivatives of the loss are not finite at these parameters")
    for direction in falling:
        lines.append(f"the point is no minimum: the loss curves downwards along {direction.words}")
    if not result.decrement <= OFF:
        lines.append(
            "the point is no optimum: the gradient asks for a step of "
            f"{math.sqrt(result.decrement):.2g} standard errors"
        )
    rows = list(zip(result.names, transforms, result.determined, strict=True))
    for i, (name, transform, good) in enumerate(rows):
        if not good:
            lines.append(unknown(name, transform, result.stderr_free[i], result.low[i], result.high[i], result.level))
    for direction in result.directions:
        if len(direction.names) > 1 and finite:
            spread = "infinite" if math.isinf(direction.stddev) else f"{direction.stddev:.3g}, above {limit:g}"
            lines.append(f"the combination {direction.words} is not determined: its standard deviation is {spread}")
    for i, j in together:
        value = result.correlation[i, j]
        verb = "move together" if value > 0.0 else "move against each other"
        number = f"{value:.2f}".replace("-", "−")
        lines.append(f"{result.names[i]} and {result.names[j]} {verb}, correlation {number}")
    for i, (name, transform, good) in enumerate(rows):
        if good:
            lines.append(known(name, transform, result.values[i], result.stderr_free[i], result.stderr[i]))
    return lines
