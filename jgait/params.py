"""Parameters in natural units, and the transforms that map them to the real line for an optimiser.

A parameter set is a NamedTuple of scalars (or arrays) in natural units. A second NamedTuple of the same type holds a
`Transform` for each field. `unconstrain` maps parameters to the whole real line and drops fixed parameters;
`constrain` maps back. A fixed parameter never reaches the optimiser.
"""

import functools
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, get_type_hints

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree, PyTreeDef

from jgait.types import SIDES, Scalar, Values

type Param = Scalar | Any
"""A field of a parameter record: a number; in a record of transforms, the transform of that number."""


class Transform(NamedTuple):
    """A smooth bijection between a parameter's range and the real line."""

    name: str  #: the name of the transform in tables, for example "positive".
    #: natural value → free value on the real line; None when the parameter is fixed.
    to_free: Callable[[Values], Values] | None
    to_natural: Callable[[Values], Values] | None  #: free value → natural value; None when the parameter is fixed.
    low: float = -math.inf  #: lower end of the open range.
    high: float = math.inf  #: upper end of the open range.
    per_subject: bool = False  #: whether each subject has a separate value, see `per_subject`.


real = Transform("real", lambda value: value, lambda free: free)
"""Any real number."""

positive = Transform("positive", jnp.log, jnp.exp, low=0.0)
"""Greater than zero; the free value is the natural logarithm."""

fixed = Transform("fixed", None, None)
"""The parameter keeps its value; the optimiser never changes it."""


@functools.cache
def interval(low: float, high: float) -> Transform:
    """A range from `low` to `high`, both excluded; the free value is the logit of the relative position in it.

    Raises ValueError unless low < high, both finite.
    """
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ValueError(f"interval(low, high) needs finite low < high; got low={low!r}, high={high!r}")
    return Transform(
        f"interval({low:g}, {high:g})", lambda value: jnp.log((value - low) / (high - value)),
        lambda free: low + (high - low) * jax.nn.sigmoid(free), low, high,
    )  # fmt: skip


def per_subject(transform: Transform) -> Transform:
    """The same range, with a separate value for each subject; `per_subject(fixed)`: a known measure of each subject."""
    return transform._replace(name=f"{transform.name}, per subject", per_subject=True)


class Parameter(NamedTuple):
    """The declaration of a field of a parameter tuple, with its default: `Annotated[Values, Parameter(…)] = 0.1`."""

    #: the range; None where the field is a tuple of parameters with declarations of its fields.
    transform: Transform | None
    unit: str  #: unit of the value; "1" where the value has no unit.
    meaning: str  #: what the parameter is, in words.
    prior: "Prior | None" = None  #: the density of the value before any data are used; None where there is none.
    #: name of the parameter with its standard deviation; "" for its own name with `_sd`, where there is one.
    stddev: str = ""


def declared(of: type) -> dict[str, Parameter]:
    """The declarations of a NamedTuple of parameters, by field."""
    hints = get_type_hints(of, include_extras=True)
    hints_of = {name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()}
    return {name: mark for name, marks in hints_of.items() for mark in marks if isinstance(mark, Parameter)}


def documented[C](of: type[C]) -> type[C]:
    """A decorator that adds the declared parameters, their units and ranges to the docstring of a class."""
    lines = [
        f"    {name}: {parameter.meaning}" + (f" [{parameter.unit}]" if parameter.unit else "")
        + (f"; {parameter.transform.name}." if parameter.transform else ".")
        for name, parameter in declared(of).items()
    ]  # fmt: skip
    of.__doc__ = "\n".join([of.__doc__ or "", "", "Attributes:", *lines])
    return of


def ranges[P](p: P) -> P:
    """The declared transforms of parameters, in the same type; `p` are as a rule the default parameters.

    An inner tuple of parameters declares its own fields; another tuple, a value for each leg, has its field's range.
    """
    return _declarations(p, lambda parameter: parameter.transform)


def priors[P](p: P) -> P:
    """The declared priors of parameters, in the same type, for `tune.fit`; None where a parameter has none."""
    return _declarations(p, lambda parameter: parameter.prior)


def _declarations[P](p: P, part: Callable[[Parameter], PyTree]) -> P:
    """A part of the declaration of every parameter, in the type of the parameters."""
    tuple_of: type[P] = type(p)

    def of_field(name: str, parameter: Parameter) -> PyTree:
        value = getattr(p, name)
        if parameter.transform is None:
            return _declarations(value, part)
        return type(value)(*[part(parameter)] * len(value)) if isinstance(value, tuple) else part(parameter)

    parts: P = tuple_of(**{name: of_field(name, parameter) for name, parameter in declared(tuple_of).items()})
    return parts


def units(p: PyTree) -> dict[str, str]:
    """The declared unit of every parameter, by the parameter's name, such as "thigh_length.right"."""
    return {
        f"{name}.{field}".rstrip("."): parameter.unit
        for name, parameter, value in _declared_in(p) for field in getattr(value, "_fields", ("",))
    }  # fmt: skip


def _declared_in(p: PyTree, before: str = "") -> Iterator[tuple[str, Parameter, PyTree]]:
    """Name, declaration and value of every parameter, also of inner records; values for both legs are one."""
    for name, parameter in declared(type(p)).items():
        value = getattr(p, name)
        if parameter.transform is None:
            yield from _declared_in(value, f"{before}{name}.")
        else:
            yield before + name, parameter, value


class Prior(NamedTuple):
    """The probability density of a parameter before any data are used."""

    name: str  #: the name of the prior in tables, for example "normal(0.43, 0.02)".
    #: natural value → minus the logarithm of the prior density, up to a constant [nat]; pure JAX.
    penalty: Callable[[Values], Values]
    stddev: Callable[[Values], Values]  #: natural value → standard deviation near it, in natural units.


class Stated(NamedTuple):
    """The stated deviation of a parameter."""

    deviation: float  #: standard deviation, in `unit`; NaN where none is stated.
    unit: str  #: natural unit of the parameter.
    source: str  #: where it is stated: a prior, or the name of the parameter that holds it; "" where nowhere.


def stated(p: PyTree) -> dict[str, Stated]:
    """The stated deviation of every parameter, by name: that of its prior, or of the parameter that holds it.

    A parameter with a value for each leg is one entry, with the mean over the legs.
    """
    by_name, beside = dict[str, Stated](), {name: value for name, _, value in _declared_in(p)}
    for name, parameter, value in _declared_in(p):
        inner, _, last = name.rpartition(".")
        holds = ".".join(filter(None, (inner, parameter.stddev or f"{last}_sd")))
        known = Stated(math.nan, parameter.unit, "")
        if parameter.prior is not None:
            known = Stated(float(np.mean(parameter.prior.stddev(_mean(value)))), parameter.unit, parameter.prior.name)
        elif holds in beside:
            of_log = parameter.transform == positive and parameter.unit == "1"  # such as K, of which log K varies
            known = Stated((_mean(value) if of_log else 1.0) * _mean(beside[holds]), parameter.unit, holds)
        sides = getattr(value, "_fields", ()) in ((), SIDES)
        by_name |= {name: known} if sides else {f"{name}.{inner}": known for inner in value._fields}
    return by_name


def _mean(value: PyTree) -> float:
    return float(np.mean([np.mean(np.asarray(leaf, float)) for leaf in jax.tree.leaves(value)]))


def normal(mean: float, stddev: float) -> Prior:
    """A normal prior in natural units. Raises ValueError if `mean` is not finite or `stddev` not positive."""
    if not (math.isfinite(mean) and math.isfinite(stddev) and stddev > 0.0):
        raise ValueError(f"normal(mean, stddev) needs a finite mean and a positive stddev; got {mean!r}, {stddev!r}")
    return Prior(
        f"normal({mean:g}, {stddev:g})", lambda value: 0.5 * ((value - mean) / stddev) ** 2, lambda _: stddev
    )  # fmt: skip


def lognormal(median: float, factor: float) -> Prior:
    """A normal prior of the logarithm: with a probability of 68 % the value is in [median / factor, median · factor].

    Raises ValueError if `median` is not positive or `factor` not above 1.
    """
    if not (math.isfinite(median) and math.isfinite(factor) and median > 0.0 and factor > 1.0):
        raise ValueError(f"lognormal(median, factor) needs median > 0 and factor > 1; got {median!r}, {factor!r}")
    spread = math.log(factor)
    return Prior(
        f"lognormal({median:g}, {factor:g})", lambda value: 0.5 * ((jnp.log(value) - math.log(median)) / spread) ** 2,
        lambda value: spread * value,
    )  # fmt: skip


def _is_transform(node: object) -> bool:
    return isinstance(node, Transform)


def _pairs(params: PyTree, transforms: PyTree) -> tuple[list[str], list[PyTree], list[Transform], PyTreeDef]:
    """Names, values and transforms in the same order; raises if `params` and `transforms` do not match."""
    treedef: PyTreeDef
    flat, treedef = jax.tree.flatten(transforms, is_leaf=_is_transform)
    if odd := [None] if transforms is None else [t for t in flat if not _is_transform(t)]:
        raise TypeError(f"transforms must hold a jgait.params.Transform for every parameter; got {odd[0]!r}")
    try:
        values = treedef.flatten_up_to(params)
    except (ValueError, TypeError) as error:
        raise TypeError(
            f"params and transforms must have the same structure; got {type(params).__name__} "
            f"and {type(transforms).__name__}: {error}"
        ) from error
    return list(names(transforms)), values, flat, treedef


def names(transforms: PyTree) -> tuple[str, ...]:
    """Names of all parameters as `freed` takes them, such as "angle_noise" and "thigh_length.right"."""
    paths, _ = jax.tree_util.tree_flatten_with_path(transforms, is_leaf=_is_transform)
    return tuple(jax.tree_util.keystr(path).lstrip(".") for path, _ in paths)


def freed[P](transforms: P, *free: str) -> P:
    """The same transforms, with every parameter fixed except those named.

    Args:
        transforms: a tuple of transforms.
        free: names as `names` returns them, or the first part of a name: "thigh_length" for both legs.

    Raises:
        ValueError: if no parameter has a given name; the message lists the known names.
    """
    every, chosen = names(transforms), set[str]()
    for name in free:
        if not (matches := {known for known in every if f"{known}.".startswith(f"{name}.")}):
            raise ValueError(f"there is no parameter {name!r}; there are {', '.join(every)}")
        chosen |= matches
    flat, treedef = jax.tree.flatten(transforms, is_leaf=_is_transform)
    return jax.tree.unflatten(treedef, [t if n in chosen else fixed for n, t in zip(every, flat, strict=True)])


def check_params(params: PyTree, transforms: PyTree, usual: PyTree = None) -> None:
    """Raise if a concrete value lies outside its range, and name the parameter.

    `usual` are parameters of one person, whose axes the values must have; None: not compared.

    Raises:
        TypeError: if the structures differ.
        ValueError: if a value is not finite, outside the open range of its transform, or of several people.
    """
    names, values, flat, treedef = _pairs(params, transforms)
    usual_values = values if usual is None else treedef.flatten_up_to(usual)
    for name, value, transform, usual_value in zip(names, values, flat, usual_values, strict=True):
        if np.ndim(value) > np.ndim(usual_value):
            raise ValueError(
                f"parameter '{name}' has the shape {np.shape(value)}, that of one person {np.shape(usual_value)}: of a "
                "fit with values per subject, take those of one person, fit.of(subject)"
            )
        if value is None or isinstance(value, jax.core.Tracer):
            continue
        array = np.asarray(value)  # NumPy: inside jit, jnp would trace concrete values too
        if not np.all(np.isfinite(array)):
            raise ValueError(f"parameter '{name}' must be finite; got {value}")
        if not np.all((array > transform.low) & (array < transform.high)):
            raise ValueError(f"parameter '{name}' must lie in ({transform.low:g}, {transform.high:g}); got {value}")


def unconstrain[P](params: P, transforms: P) -> P:
    """Map parameters in natural units to free values on the real line; a fixed parameter becomes None, no leaf."""
    _, values, flat, treedef = _pairs(params, transforms)
    pairs = zip(values, flat, strict=True)
    free = [None if t.to_free is None or v is None else t.to_free(jnp.asarray(v)) for v, t in pairs]
    return jax.tree.unflatten(treedef, free)


def constrain[P](free: P, transforms: P, params: P) -> P:
    """Map free values back to natural units, the inverse of `unconstrain`; fixed values are copied from `params`."""
    _, values, flat, treedef = _pairs(params, transforms)
    triples = zip(treedef.flatten_up_to(free), values, flat, strict=True)
    natural = [v if t.to_natural is None or f is None else t.to_natural(f) for f, v, t in triples]
    return jax.tree.unflatten(treedef, natural)
