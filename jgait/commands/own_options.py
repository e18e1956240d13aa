"""Options of the command line that only some estimators have, collected from the estimators' `about`."""

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple

import typer
from jaxtyping import PyTree

from jgait import estimators
from jgait.commands.console import stop
from jgait.estimators.about import About, BodyMeasure, CommandOption
from jgait.estimators.proportions import outside


class OwnOption(NamedTuple):
    """An option, and the names of the estimators that have it."""

    option: CommandOption
    estimators: tuple[str, ...]

    @property
    def variable(self) -> str:
        """The name of the option as an argument of a function."""
        return self.option.name.removeprefix("--").replace("-", "_")


def options_of(about: About) -> dict[str, CommandOption]:
    """The options of an estimator by name: the options of its `about`, and one for each of its body measures."""
    stated = {option.name: option for option in about.options}
    measured = {m.option: _of_measure(m) for m in about.measures if m.option and m.option not in stated}
    return measured | stated


def _of_measure(measure: BodyMeasure) -> CommandOption:
    default = "" if measure.default is None else f"; {measure.default:g}"
    text = f"{measure.meaning} [{measure.unit}]{default}."
    return CommandOption(measure.option, text, low=measure.low, high=measure.high)


@functools.cache
def own_options() -> dict[str, OwnOption]:
    """All options that only some estimators have, in the order of the registry."""
    found: dict[str, OwnOption] = {}
    for name in estimators.names():
        for option in options_of(estimators.about_of(name)).values():
            known = found.get(option.name, OwnOption(option, ()))
            found[option.name] = known._replace(estimators=(*known.estimators, name))
    return found


def with_own_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose argument `**own` becomes one option for each of `own_options`, for typer.

    In its docstring `{estimators}` becomes a line for each estimator.
    """
    signature = inspect.signature(command)
    parameters = []
    for parameter in signature.parameters.values():
        if parameter.kind is inspect.Parameter.VAR_KEYWORD:
            parameters += [_parameter(option) for option in own_options().values()]
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    @functools.wraps(command)
    def wrapped(**values: Any) -> None:
        command(**values)

    wrapped.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    lines = [_line(name) for name in estimators.names()]
    wrapped.__doc__ = inspect.cleandoc(command.__doc__ or "").replace("{estimators}", "\n\n".join(lines))
    return wrapped


def _parameter(known: OwnOption) -> inspect.Parameter:
    kind, low, high = known.option.kind, known.option.low, known.option.high
    text = f"{', '.join(known.estimators)}: {known.option.help}"
    if low is not None and high is not None and "[m]" in known.option.help:
        text += f" From {low:g} to {high:g}."
        declared = typer.Option(
            known.option.name, callback=_in_metres(known.variable, low, high), help=text,
            parser=_number if kind is float else None, metavar="FLOAT" if kind is float else None,
        )  # fmt: skip
    else:
        declared = typer.Option(known.option.name, min=low, max=high, help=text)
    return inspect.Parameter(
        known.variable, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[kind | None, declared]
    )


def _number(text: str) -> float:
    """The number of an option; the message about a decimal comma says what to write instead."""
    try:
        return float(text)
    except ValueError:
        hint = f"; write a decimal point, {text.replace(',', '.')}" if text.count(",") == 1 else ""
        raise typer.BadParameter(f"{text!r} is no number{hint}") from None


def _in_metres(variable: str, low: float, high: float) -> Callable[[float | None], float | None]:
    def checked(value: float | None) -> float | None:
        wrong = "" if value is None else outside(variable.replace("_", " "), value, low, high)
        if wrong:
            raise typer.BadParameter(wrong)
        return value

    return checked


def _line(name: str) -> str:
    about = estimators.about_of(name)
    return f"{name}: {about.title}. {'Columns: ' + about.needs if about.needs else ''}".rstrip()


def stated(values: Mapping[str, PyTree]) -> list[tuple[OwnOption, PyTree]]:
    """The options that are given, each with its value; `values` are arguments, see `with_own_options`."""
    pairs = ((known, values.get(known.variable)) for known in own_options().values())
    return [(known, value) for known, value in pairs if value is not None]


def given_of(name: str, values: Mapping[str, PyTree]) -> dict[str, Any]:
    """Given options → parsed values; exits with code 2 for an option that the estimator does not have."""
    given: dict[str, Any] = {}
    mine = options_of(estimators.about_of(name))
    for known, value in stated(values):
        if known.option.name not in mine:
            refuse(known.option.name, known.estimators, name)
        option = mine[known.option.name]
        try:
            given[option.name] = value if option.parse is None else option.parse(value)
        except ValueError as error:
            stop(str(error))
    return given


def refuse(option: str, known: tuple[str, ...], name: str) -> None:
    """Exit with code 2: the option belongs to other estimators."""
    stop(f"{option} is an option of {' and '.join(known)}; got --estimator {name}")


def remarks(name: str, values: Mapping[str, Any]) -> list[str]:
    """Notes about the estimator's options, before the computation."""
    notes = []
    for option in options_of(estimators.about_of(name)).values():
        if option.remark is not None:
            notes.append(option.remark(values.get(own_options()[option.name].variable)))
    return [text for text in notes if text]
