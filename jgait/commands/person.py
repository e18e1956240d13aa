"""Measures of a person from a file and from options of the command line."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer
from jaxtyping import PyTree

from jgait import estimators
from jgait.commands.console import stop
from jgait.commands.own_options import stated
from jgait.estimators.proportions import outside

PersonFile = Annotated[
    Path | None,
    typer.Option("--person", help='Measures of the person in metres, JSON such as {"height": 1.75}; options win.'),
]


def person_in(file: Path | None) -> dict[str, PyTree]:
    """The measures in a JSON file, name → number or [right, left]; exits with code 2 if the file cannot be used."""
    if file is None:
        return {}
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        stop(f'--person {file} is no JSON file with measures, such as {{"height": 1.75}}: {error}')
    except OSError as error:
        stop(f"--person {file}: {error}")
    known = _measures()
    if not isinstance(content, dict) or not content:
        stop(f"--person {file} holds one object with measures such as height; got {str(content)[:60]!r}")
    for name, value in content.items():
        if name not in known:
            stop(f"--person {file}: a person has {', '.join(sorted(known))}; got {name!r}")
        numbers = value if isinstance(value, list) else [value]
        low, high = known[name]
        if len(numbers) not in (1, 2) or not all(isinstance(v, int | float) for v in numbers):
            stop(f"--person {file}: {name} is {low:g} to {high:g} m, one number or [right, left]; got {value!r}")
        for wrong in filter(None, (outside(name, number, low, high) for number in numbers)):
            stop(f"--person {file}: {wrong}")
    return {name: tuple(value) if isinstance(value, list) else value for name, value in content.items()}


def _measures() -> dict[str, tuple[float, float]]:
    """Every measure of a person that an estimator takes, and its range."""
    every = [measure for name in estimators.names() for measure in estimators.about_of(name).measures]
    return {measure.name: (measure.low, measure.high) for measure in every}


def person_of(file: Path | None, values: Mapping[str, PyTree]) -> dict[str, PyTree]:
    """The measures of a file and of the options of `with_own_options`; exits with code 2 for an option that is none."""
    person = person_in(file)
    for known, value in stated(values):
        abouts = [estimators.about_of(name) for name in known.estimators]
        names = {measure.name for about in abouts for measure in about.measures if measure.option == known.option.name}
        if not names:
            stop(f"{known.option.name} is an option of {' and '.join(known.estimators)}; give --estimator as well")
        person |= dict.fromkeys(names, value)
    return person
