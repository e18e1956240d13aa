"""Measures of a person, and the options that only some estimators have, as their `about` states them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from jaxtyping import PyTree

from jgait import estimators
from jgait.commands.console import meant, refused, stop
from jgait.estimators.about import About, CommandOption
from jgait.estimators.proportions import in_metres, outside
from jgait.io.files import json_object

PersonFile = Annotated[
    Path | None,
    typer.Option("--person", help='Measures of the person in metres, JSON such as {"height": 1.75}; options win.'),
]
Height = Annotated[str | None, typer.Option(metavar="METRES", help="Of the person, 0.8 to 2.4.")]
Thigh = Annotated[str | None, typer.Option(metavar="METRES", help="Its length, hip to knee, 0.2 to 0.7; 0.43.")]
Shank = Annotated[str | None, typer.Option(metavar="METRES", help="Its length, knee to ankle, 0.2 to 0.7; 0.43.")]
Options = Annotated[
    list[str] | None,
    typer.Option("--option", metavar="NAME=VALUE", help="Of some estimators, see below; once for each."),
]
PLAIN = ("--height", "--thigh", "--shank")
"""The options of some estimators that have a name of their own on the command line."""


def named(option: str) -> str:
    """An option as it is written on the command line: --height, or --option level."""
    return option if option in PLAIN else f"--option {option.removeprefix('--')}"


def options_of(about: About) -> dict[str, CommandOption]:
    """The options of an estimator by name: the options of its `about`, and one for each of its body measures."""
    measured = {}
    for m in filter(lambda measure: measure.option, about.measures):
        default = "" if m.default is None else f"; {m.default:g}"
        measured[m.option] = CommandOption(m.option, f"{m.meaning} [{m.unit}]{default}.", low=m.low, high=m.high)
    return measured | {option.name: option for option in about.options}


EVERY = {name: options_of(estimators.about_of(name)) for name in estimators.names()}
"""Estimator → its options by name."""


def owners(option: str) -> list[str]:
    """The names of the estimators that have an option."""
    return [name for name, options in EVERY.items() if option in options]


def epilog() -> str:
    """A paragraph for each estimator, with the columns that it needs, and one for each of its `Options`."""
    abouts = {name: estimators.about_of(name) for name in EVERY}
    lines = [f"{name}: {about.title}." + f" Columns: {about.needs}" * bool(about.needs)
             for name, about in abouts.items()]  # fmt: skip
    known = {name: option for options in EVERY.values() for name, option in options.items() if name not in PLAIN}
    lines += [f"{named(name)} ({', '.join(owners(name))}): {option.help}" for name, option in known.items()]
    return "\n\n".join(lines)


def given(texts: list[str] | None, height: str | None, thigh: str | None, shank: str | None) -> dict[str, str]:
    """Option, as in `about` → text; exits with code 2 for a text without "=", or an option that no estimator has."""
    values = dict(zip(PLAIN, (height, thigh, shank), strict=True))
    for text in texts or ():
        name, equals, value = text.partition("=")
        option = f"--{name.strip().replace('_', '-')}"
        if not equals or not owners(option):
            names = sorted({known.removeprefix("--") for options in EVERY.values() for known in options})
            stop(f"--option is NAME=VALUE, with one of the names {', '.join(names)}; got {text!r}")
        values[option] = value.strip()
    return {name: value for name, value in values.items() if value is not None}


def given_of(name: str, values: Mapping[str, str]) -> dict[str, Any]:
    """Option → value, for an estimator; exits with code 2 for a value out of range, or an option that it lacks."""
    mine = EVERY.get(name, {})
    for option in values:
        if option not in mine:
            stop(f"{named(option)} is an option of {' and '.join(owners(option))}; got --estimator {name}")
    return {option: _value(mine[option], text) for option, text in values.items()}


def _value(option: CommandOption, text: str) -> Any:
    """The value of a text; exits with code 2 if it is none."""
    value: Any = text
    with refused():
        if option.kind is float:
            try:
                value = float(text)
            except ValueError:
                hint = f"; write a decimal point, {text.replace(',', '.')}" if text.count(",") == 1 else ""
                stop(f"{named(option.name)}: {text!r} is no number{hint}")
            low, high = option.low, option.high
            if low is not None and high is not None:
                if wrong := outside(option.name.removeprefix("--").replace("-", " "), value, low, high):
                    stop(wrong)
            elif low is not None and not value >= low:
                stop(f"{named(option.name)} must be at least {low:g}; got {text}")
        return value if option.parse is None else option.parse(value)


def person_in(file: Path | None) -> dict[str, PyTree]:
    """The measures in a JSON file, name → number or [right, left]; exits with code 2 if the file cannot be used."""
    if file is None:
        return {}
    with refused("--person: "):
        content = json_object(file)
        if not content:
            raise ValueError(f"{file} holds one object with measures such as height; got {{}}")
    known = {m.name: (m.low, m.high) for name in EVERY for m in estimators.about_of(name).measures}
    with refused(f"--person {file}: "):
        content = in_metres(content)
        for name, value in content.items():
            if name not in known:
                names = f"{', '.join(sorted(known))}, also with _m behind the name"
                raise ValueError(f"a person has {names}; got {name!r}{meant(name, known)}")
            numbers, (low, high) = value if isinstance(value, list) else [value], known[name]
            if len(numbers) not in (1, 2) or not all(isinstance(v, int | float) for v in numbers):
                raise ValueError(f"{name} is {low:g} to {high:g} m, one number or [right, left]; got {value!r}")
            for wrong in filter(None, (outside(name, number, low, high) for number in numbers)):
                raise ValueError(wrong)
    return {name: tuple(value) if isinstance(value, list) else value for name, value in content.items()}


def person_of(file: Path | None, values: Mapping[str, str]) -> dict[str, PyTree]:
    """The measures of a file and of options, as of `given`; exits with code 2 for an option that is no measure."""
    person = person_in(file)
    for option, text in values.items():
        known = owners(option)
        names = {m.name for name in known for m in estimators.about_of(name).measures if m.option == option}
        if not names:
            stop(f"{named(option)} is an option of {' and '.join(known)}; give --estimator as well")
        person |= dict.fromkeys(names, _value(EVERY[known[0]][option], text))
    return person
