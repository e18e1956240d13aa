"""What a function depends on, read from its trace by `jax.make_jaxpr`."""

from collections.abc import Callable
from typing import Any

import jax
from jaxtyping import Array, Float


def depends_on_place(g: Callable[[Array], Array], at: Float[Array, "n"]) -> bool:
    """Whether the Jacobian of g depends on g's argument, determined from the trace of the derivative."""

    def directional(x: Array, tangent: Array) -> Array:
        return jax.jvp(g, (x,), (tangent,))[1]

    closed = jax.make_jaxpr(directional)(at, at)
    return any(reached(closed.jaxpr, {closed.jaxpr.invars[0]}))


def reached(jaxpr: Any, sources: set[Any]) -> list[bool]:
    """For each output of a jaxpr, whether any of the source variables can influence it.

    Called functions are analysed too; in a loop or branch every input counts as an influence on every output.
    """
    touched = set(sources)

    def hit(variable: Any) -> bool:
        return not hasattr(variable, "val") and variable in touched  # a literal has a value

    for equation in jaxpr.eqns:
        inputs = [hit(v) for v in equation.invars]
        if not any(inputs):
            continue
        body = _called(equation)
        if body is not None:
            outputs = reached(body, {v for v, touches in zip(body.invars, inputs, strict=True) if touches})
        else:
            outputs = [True] * len(equation.outvars)
        touched |= {v for v, touches in zip(equation.outvars, outputs, strict=True) if touches}
    return [hit(v) for v in jaxpr.outvars]


def _called(equation: Any) -> Any:
    """The jaxpr that an equation calls once with the equation's inputs, or None."""
    if equation.primitive.name in ("scan", "while", "cond"):
        return None
    inner = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
    body = getattr(inner, "jaxpr", inner)
    if body is None or len(body.invars) != len(equation.invars) or len(body.outvars) != len(equation.outvars):
        return None
    return body
