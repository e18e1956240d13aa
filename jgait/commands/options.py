"""Options of several commands, and what they select: an estimator with its settings, parameters, a person."""

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from jaxtyping import PyTree

from jgait import estimators, io
from jgait.commands.console import count, note, refused, stop
from jgait.estimators import About, Estimator, proportions
from jgait.estimators.about import CommandOption, Settings
from jgait.estimators.proportions import in_metres, outside
from jgait.io.files import json_object
from jgait.notes import DEFAULT_MEASURE, Kind, Note, meant
from jgait.params import check_params
from jgait.types import Estimate, Recording, people

EstimatorName = Annotated[
    str, typer.Option("--estimator", "--method", help=f"Which estimator: {', '.join(estimators.names())}.")
]
OneEstimator = Annotated[
    str | None, typer.Option("--estimator", "--method", help=f"One method alone: {', '.join(estimators.names())}.")
]
Paper = Annotated[bool, typer.Option("--paper", help="The paper's pipeline instead of the default one.")]
Params = Annotated[
    Path | None, typer.Option("--params", help="Parameters of this file, or preset:NAME; see jgait presets.")
]
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

NOT_HELD_OUT = Kind(
    "not_held_out", "check",
    "the parameters in {file} were tuned on {cohort}: {which} not held out{others}",
    "Parameters fit the people on whom they were tuned better than others. Errors on other people are in held_out.csv, "
    "which jgait tune wrote beside the parameters. Recordings are compared by their content, people by their names.",
)  # fmt: skip
HELD_OUT = Kind(
    "held_out", "info",
    "the parameters in {file} were tuned on {cohort}: of {recordings} {recordings:recording|recordings}, none is of "
    "that tuning{others}",
    "Recordings are compared by their content, people by their names: a person with another name is not noticed.",
)  # fmt: skip
MEASURES_ABSENT = Kind("measures_absent", "check", "{options}: {consequence}", DEFAULT_MEASURE)


def named(option: str) -> str:
    """An option as it is written on the command line: --height, or --option level."""
    return option if option in PLAIN else f"--option {option.removeprefix('--')}"


@functools.cache
def options_of(estimator: str) -> dict[str, CommandOption]:
    """The options of an estimator by name: the options of its `about`, and one for each of its body measures."""
    measured, about = {}, estimators.about_of(estimator)
    for m in filter(lambda measure: measure.option, about.measures):
        default = "" if m.default is None else f"; {m.default:g}"
        measured[m.option] = CommandOption(m.option, f"{m.meaning} [{m.unit}]{default}.", low=m.low, high=m.high)
    return measured | {option.name: option for option in about.options}


def owners(option: str) -> list[str]:
    """The names of the estimators that have an option."""
    return [name for name in estimators.names() if option in options_of(name)]


def epilog() -> str:
    """A paragraph for each estimator, with the columns that it needs, and one for each of its `Options`."""
    abouts = {name: estimators.about_of(name) for name in estimators.names()}
    lines = [f"{name}: {about.title}." + f" Columns: {about.needs}" * bool(about.needs)
             for name, about in abouts.items()]  # fmt: skip
    known = {name: option for method in abouts for name, option in options_of(method).items() if name not in PLAIN}
    lines += [f"{named(name)} ({', '.join(owners(name))}): {option.help}" for name, option in known.items()]
    return "\n\n".join(lines)


def given(texts: list[str] | None, height: str | None, thigh: str | None, shank: str | None) -> dict[str, str]:
    """Option, as in `about` → text; exits with code 2 for a text without "=", or an option that no estimator has."""
    values = dict(zip(PLAIN, (height, thigh, shank), strict=True))
    for text in texts or ():
        name, equals, value = text.partition("=")
        option = f"--{name.strip().replace('_', '-')}"
        if not equals or not owners(option):
            names = sorted({known.removeprefix("--") for method in estimators.names() for known in options_of(method)})
            stop(f"--option is NAME=VALUE, with one of the names {', '.join(names)}; got {text!r}")
        values[option] = value.strip()
    return {name: value for name, value in values.items() if value is not None}


def given_of(name: str, values: Mapping[str, str]) -> dict[str, Any]:
    """Option → value, for an estimator; exits with code 2 for a value out of range, or an option that it lacks."""
    mine = options_of(name)
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
    known = {m.name: (m.low, m.high) for name in estimators.names() for m in estimators.about_of(name).measures}
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
        person |= dict.fromkeys(names, _value(options_of(known[0])[option], text))
    return person


class Choice(NamedTuple):
    """The estimator that the options of the command line select."""

    estimator: Estimator[PyTree, PyTree]  #: the estimator with its settings.
    settings: Settings  #: arguments of the estimator, see `jgait.estimators.about.Settings`.
    params: PyTree  #: parameters to start from.
    given: dict[str, Any]  #: option → value, of the options that only some estimators have.
    paper: bool = False  #: whether this is the paper's pipeline.

    def personal(self, known: Mapping[str, Any]) -> tuple[PyTree, list[Note]]:
        """The parameters of one person, and notes about measures for which the default is used."""
        about = self.estimator.about
        names = [measure.name for measure in about.measures]
        measured = {m.name: self.given[m.option] for m in about.measures if m.option in self.given}
        given = {name: value for name, value in {**known, **measured}.items() if name in names}
        p = self.estimator.with_body(self.params, given)
        for option in about.options:
            if option.params is not None and option.name in self.given:
                p = option.params(p, self.given[option.name])
        wanted = [name for name in names if name != "height"] if proportions.gives(names) else names
        lacking = missing(about, proportions.with_proportions(given, wanted), self.params, self.estimator.params)
        return p, [*(proportions.height_notes(given, names) if "height" in given else ()), *lacking]

    def estimate(self, p: PyTree, recording: Recording) -> Estimate:
        """The estimate of one recording."""
        return self.estimator.estimate(p, recording)


def missing(about: About, body: Mapping[str, Any], params: PyTree, default: PyTree) -> list[Note]:
    """Notes about measures that are known neither from the person nor from parameters that differ from the default."""
    measures = {measure.name: measure for measure in about.measures}
    notes: list[Note] = []
    for group in about.missing:
        lacking = []
        for name in group.measures:
            parameter = measures[name].parameter or name
            if name not in body and np.all(np.equal(getattr(params, parameter), getattr(default, parameter))):
                lacking.append(named(measures[name].option))
        if not lacking or (group.any_one and len(lacking) < len(group.measures)):
            continue
        options = list(dict.fromkeys(lacking))
        words = f"neither {' nor '.join(options)}" if group.any_one else f"no {' and '.join(options)}"
        notes.append(MEASURES_ABSENT(options=words, consequence=group.text.format(p=params)))
    return notes


def chosen(name: str, paper: bool, file: Path | None, values: Mapping[str, Any]) -> Choice:
    """The choice of the options, with `values` of those that only some estimators have; exits with code 2 if there is
    none.
    """
    settings, given = _settings(name, paper, file), given_of(name, values)
    for option in estimators.about_of(name).options:
        if option.remark is not None and (text := option.remark(given.get(option.name))):
            note(text)
        if option.settings is not None and option.name in given:
            settings = option.settings(settings, given[option.name])
    for line in not_held_out(file):
        note(line)
    estimator = estimators.get(name, **settings)
    return Choice(estimator, settings, start_of(estimator, file, paper), given, paper)


def _settings(name: str, paper: bool, file: Path | None) -> Settings:
    """The settings of the pipeline, with those for which the parameters in a file were tuned; exits with code 2 if
    there is no such estimator, or these cannot be read, or do not exist.
    """
    with refused():
        about = estimators.get(name).about
    if paper and about.paper is None:
        known = [estimator for estimator in estimators.names() if estimators.about_of(estimator).paper is not None]
        stop(f"--paper is an option of {' and '.join(known)}; got --estimator {name}")
    options: Any = about.paper if paper else about.default
    tuned: dict[str, Any] = {}
    if file is not None:
        with refused("--params: "):
            of, made = io.made_of(file)
        if of in estimators.names() and estimators.about_of(of) != about:
            stop(f"--params: {file} holds parameters of {of}; give --estimator {of}, or a file of this estimator")
        tuned = dict(made.get("options", {}))
    unknown = [option for option in tuned if option not in getattr(options, "_fields", ())]
    if unknown:
        stop(f"--params: {file} was tuned with the option {unknown[0]!r}, which this estimator does not have")
    return {} if options is None else {"options": options._replace(**tuned) if tuned else options}


def pipeline_of(
    name: str, paper: bool, file: Path | None = None, noise: str | None = None, soft: bool = False
) -> Estimator[PyTree, PyTree]:
    """The estimator, with a noise model and soft stances if asked for; exits with code 2 if there is none."""
    settings = _settings(name, paper, file)
    options: Any = settings.get("options")
    fields = getattr(options, "_fields", ())
    if noise is not None and "noise" not in fields:
        stop(f"{name} has no noise models to choose from")
    asked = ({} if noise is None else {"noise": noise}) | ({"soft": True} if soft and "soft" in fields else {})
    with refused():
        return estimators.get(name, **({"options": options._replace(**asked)} if asked else settings))


def measures_of(estimator: Estimator[PyTree, PyTree]) -> tuple[str, ...]:
    """The body measures that set parameters of the estimator."""
    fields = set(getattr(estimator.params, "_fields", ()))
    return tuple(measure.name for measure in estimator.about.measures if {measure.name, measure.parameter} & fields)


def start_of(estimator: Estimator[PyTree, PyTree], file: Path | None, paper: bool) -> PyTree:
    """The estimator's default parameters, or those of a file; exits with code 2 if the file cannot be used."""
    if file is None:
        return estimator.params
    with refused("--params: "):
        params, made = io.read_params(file, estimator.params, estimator=estimator.name)
        check_params(params, estimator.transforms)
    tuned_for, name = made.get("pipeline"), "paper" if paper else "default"
    if tuned_for not in (None, name):
        note(f"{file} was tuned for the pipeline {tuned_for!r}; this one is {name!r}")
    return params


def tunings(file: Path | None) -> list[dict[str, Any]]:
    """How the parameters of a file were tuned, and those from which that began, the last first."""
    made = {} if file is None else io.made_of(file)[1]
    return [made, *made.get("before", ())]


def not_held_out(
    file: Path | None, versions: Mapping[str, str] | None = None, subjects: Mapping[str, str] | None = None
) -> tuple[Note, ...]:
    """The note that a file of parameters was tuned on a cohort, with the errors held out; with versions and subjects of
    the recordings to be judged, by name, how many of them are among those of the tuning.
    """
    first, *before = tunings(file)
    if file is None or not first.get("cohort"):
        return ()
    judged: Any = first.get("held_out")
    judged_on, others, every = set(first.get("data", {}).values()), "", (first, *before)
    earlier = {content for tuning in before for content in tuning["data"].values()}
    if judged and not judged_on & earlier:
        others = (
            f"; with {first.get('left_out', 'people')} left out in turn, the median {judged['error']} was "
            f"{judged['before']:.3g} {judged['unit']} before and {judged['after']:.3g} {judged['unit']} after"
        )
    cohort = " and ".join(dict.fromkeys(Path(str(tuning["cohort"])).name for tuning in every))
    made = {"file": Path(file).name, "cohort": cohort, "others": others}
    if versions is None or "subjects" not in first:
        return (NOT_HELD_OUT(which="errors on people of that cohort are", **made),)
    used = {recording for recording, content in versions.items() if content in judged_on | earlier}
    unused = [who for recording, who in (subjects or {}).items() if recording in versions.keys() - used]
    known = sorted({who for tuning in every for who in tuning["subjects"]})
    names = people([*known, *unused])
    same = sum(who in names[: len(known)] for who in names[len(known) :])
    if not used and not same:
        return (HELD_OUT(recordings=len(versions), **made),)
    parts = {"used there": len(used), "of people with names used there": same}
    each = " and ".join(f"{number} {what}" for what, number in parts.items() if number)
    which = f"of {count(len(versions), 'recording', 'recordings')}, {each}, so that errors on them are"
    return (NOT_HELD_OUT(which=which, **made),)
