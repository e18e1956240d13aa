"""Texts that are equal, in every process, for functions and values that compute the same."""

import dataclasses
import dis
import functools
import hashlib
import inspect
import re
from pathlib import Path
from types import CodeType, FunctionType

import jax
import numpy as np

OURS = "jgait"
"""Package whose named functions are told apart by name alone: what depends on them compares its version as well."""


def described(value: object) -> str:
    """A text of a value: a function by name, code, defaults, and the values that it uses; arrays by content.

    Of the values of a function's closure, of its module's variables and of the attributes of a callable object, those
    are part of the text that do not change by themselves: numbers, text, arrays, tuples, dataclasses and functions, of
    other modules by name. Of others (lists, tables, open files) the type alone is.
    """
    return _text(value, set())


def _text(value: object, seen: set[int]) -> str:
    """`described`; a function in `seen` is not described again."""
    if isinstance(value, functools.partial):
        inner = ", ".join(_text(part, seen) for part in (value.func, value.args, value.keywords))
        return f"partial({inner})"
    if inspect.isfunction(value):
        return _function(value, seen)
    if inspect.ismethod(value):
        return f"{_text(value.__func__, seen)} of {_text(value.__self__, seen)}"
    if isinstance(value, jax.Array | np.ndarray) and np.ndim(value):
        array = np.asarray(value)
        return f"{array.dtype}{list(array.shape)} {_digest(array.tobytes())}"
    if isinstance(value, jax.Array | np.generic | np.ndarray):
        return repr(value.item())
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        pairs = zip(value._fields, value, strict=True)
        return f"{type(value).__name__}({', '.join(f'{k}={_text(v, seen)}' for k, v in pairs)})"
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return f"{type(value).__qualname__}({', '.join(f'{k}={_text(v, seen)}' for k, v in fields.items())})"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k}: {_text(v, seen)}" for k, v in sorted(value.items())) + "}"
    if isinstance(value, tuple | list):
        return "(" + ", ".join(_text(v, seen) for v in value) + ")"
    if callable(value) and not isinstance(value, type):
        return _callable(value, seen)
    return printed(value)


def _function(function: FunctionType, seen: set[int]) -> str:
    name = f"{function.__module__}.{function.__qualname__}"
    if id(function) in seen:
        return name
    seen.add(id(function))
    # the version of `OURS` is compared, and a type checker changes the code of its functions, but not of lambdas
    ours = function.__module__.partition(".")[0] == OURS and function.__name__ != "<lambda>"
    function = inspect.unwrap(function) if ours else function
    code = function.__code__
    cells = zip(code.co_freevars, function.__closure__ or (), strict=True)
    held = {free: _held(cell.cell_contents, seen) for free, cell in cells if cell != _EMPTY}
    names = () if ours else sorted(_globals(code))
    known = {each: function.__globals__[each] for each in names if each in function.__globals__}
    used = {each: _global(function.__module__, other, seen) for each, other in known.items()}
    defaults = [_held(each, seen) for each in function.__defaults__ or ()]
    keywords = {each: _held(other, seen) for each, other in (function.__kwdefaults__ or {}).items()}
    inside = ", ".join(f"{free}: {text}" for free, text in held.items())
    digest = _digest(repr((() if ours else _code(code), defaults, keywords, used)).encode())
    return f"{name}{f' {{{inside}}}' if inside else ''} {digest}"


_EMPTY = type((lambda x: lambda: x)(0).__closure__[0])()  # type: ignore[index]
"""The cell of a variable that has no value yet."""


def _callable(value: object, seen: set[int]) -> str:
    """A callable object: what it wraps, as `jax.jit` does; its own printed form; or its code and attributes."""
    if hasattr(value, "__wrapped__"):
        return f"{type(value).__name__}({_text(value.__wrapped__, seen)})"
    call = type(value).__call__
    if type(value).__repr__ is not object.__repr__ or not inspect.isfunction(call):
        return printed(value)
    held = {name: _held(each, seen) for name, each in sorted(getattr(value, "__dict__", {}).items())}
    return f"{type(value).__qualname__} {held} {_text(call, seen)}"


def _held(value: object, seen: set[int]) -> str:
    """A value that a function holds; an object that may change (counter, cache, table) by its type alone."""
    plain = isinstance(value, tuple | str | bytes | int | float | complex | Path | jax.Array | np.ndarray | np.generic)
    fixed = dataclasses.is_dataclass(value) or (callable(value) and not isinstance(value, type))
    return _text(value, seen) if plain or fixed or value is None else type(value).__name__


def _global(module: str, value: object, seen: set[int]) -> str:
    """A variable of a function's module; functions of other modules by their names."""
    name = getattr(value, "__qualname__", None)
    if name is not None and getattr(value, "__module__", module) != module:
        return f"{value.__module__}.{name}"
    return _held(value, seen)


def _globals(code: CodeType) -> set[str]:
    """Names of the variables of the module that a function uses, also in functions inside it."""
    names = {line.argval for line in dis.get_instructions(code) if line.opname in ("LOAD_GLOBAL", "LOAD_NAME")}
    return names.union(*(_globals(inner) for inner in code.co_consts if inspect.iscode(inner)))


def _code(code: CodeType) -> tuple[object, ...]:
    """What a function computes, without the lines and the file where it stands."""
    constants = [
        _code(each) if inspect.iscode(each) else sorted(map(repr, each)) if isinstance(each, frozenset) else repr(each)
        for each in code.co_consts
    ]
    return code.co_code, code.co_names, constants


def printed(value: object) -> str:
    """The printed form of a value, without the address in memory, which changes from run to run."""
    return re.sub(r" at 0x[0-9a-fA-F]+", "", repr(value))


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
