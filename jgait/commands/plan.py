"""`jgait plan`: the errors that set-ups of sensors would give, from simulated people or from a recording."""

import contextlib
import math
from pathlib import Path
from typing import Annotated, Any

import jax
import pandas as pd
import typer

from jgait import plot
from jgait.commands import options, recordings
from jgait.commands.console import Bar, progress, refused, say, show, stop, write_json, wrote
from jgait.commands.folder import keep_inputs
from jgait.commands.simulate import sensor_of
from jgait.estimators.columns import QUANTITIES
from jgait.evaluate import study
from jgait.geometry.vectors import GRAVITY
from jgait.notes import printable
from jgait.simulate import GAITS
from jgait.types import PLACEMENTS, SIDES, RecordingError

GROUPS = {f"{part}s" if part != "foot" else "feet": tuple(f"{part}_{side}" for side in SIDES)
          for part in ("foot", "shank", "ankle", "thigh")}  # fmt: skip
"""Word for the sensors of both sides → placements."""


def plan(
    file: Annotated[
        Path | None,
        typer.Argument(help="A recording: what this walk would have given. None: simulated people."),
    ] = None,
    measure: Annotated[str, typer.Option(help="A measure of strides, such as walking_speed.")] = "stride_length",
    within: Annotated[float | None, typer.Option(help="Largest error of the mean [m, m/s, °].")] = None,
    people: Annotated[int, typer.Option(min=1, help="Whose mean is asked for; 1: each person.")] = 1,
    places: Annotated[
        str, typer.Option(help="Sets of sensors: feet,foot_right,shanks,waist; with + between sensors of a set.")
    ] = "feet,foot_right,shanks,waist",
    rates: Annotated[str, typer.Option(help="Sampling rates [Hz].")] = "50,100",
    acc_ranges: Annotated[str, typer.Option(help="Ranges of the accelerometer [g]; inf: as recorded.")] = "inf",
    gyr_ranges: Annotated[str, typer.Option(help="Ranges of the gyroscope [°/s]; inf: as recorded.")] = "inf",
    duties: Annotated[str, typer.Option(help="Shares of the time in which gyroscopes of shanks are on.")] = "1",
    minutes: Annotated[str, typer.Option(help="Lengths of the recording [min]; inf: all.")] = "inf",
    simulated: Annotated[int, typer.Option(min=2, help="Number of simulated people.")] = 20,
    metres: Annotated[float, typer.Option(min=5.0, max=1000.0, help="They walk this far.")] = 30.0,
    gait: Annotated[str | None, typer.Option(help=f"Of simulated people: {', '.join(GAITS)}.")] = None,
    sensors: Annotated[str, typer.Option(help="Of simulated people, such as on_shoe, opal, mpu6000.")] = "on_shoe",
    seed: Annotated[int, typer.Option(help="Random seed of simulated people.")] = 0,
    person: options.PersonFile = None,
    height: options.Height = None,
    thigh: options.Thigh = None,
    shank: options.Shank = None,
    rate: recordings.Rate = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    format: recordings.Format = None,
    place: recordings.Place = None,
    trial: recordings.Trial = None,
    figure: Annotated[Path | None, typer.Option(help="Draw the errors into this file, PNG or SVG.")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the table here.")] = None,
) -> None:
    """Say what a study would measure with other sensors: a table of set-ups, the smallest expected error first.

    All combinations of the sets of sensors, rates, ranges, duty cycles and minutes are compared. Without a file, people
    are simulated and the errors are those against their exact truth. With a file, the recording is degraded to each
    set-up, and compared with its own estimate at full quality, whose stated deviation is added. Exit code 0: success;
    2: no set-up can be used.
    """
    keep_inputs([figure, json_file], [file, person])
    if gait is not None and gait not in GAITS:
        stop(f"--gait must be one of {', '.join(GAITS)}; got {gait!r}")
    if measure not in QUANTITIES:
        stop(f"--measure is a measure of strides, such as stride_length; got {measure!r}")
    sets = [_places(text) for text in places.split(",")]
    choices = study.setups(
        placements=sets, rate_hz=_numbers("--rates", rates),
        acc_range=[GRAVITY * g for g in _numbers("--acc-ranges", acc_ranges)],
        gyr_range=[math.radians(v) for v in _numbers("--gyr-ranges", gyr_ranges)],
        duty=_numbers("--duties", duties), seconds=[60.0 * m for m in _numbers("--minutes", minutes)],
    )  # fmt: skip
    if math.inf in (*(c.rate_hz for c in choices), *(c.duty for c in choices)):
        stop("--rates and --duties are finite numbers")
    errors = sensor_of(sensors)
    with progress() as bars, refused():
        bar = Bar(bars)
        if file is None:
            bar.begin(f"simulating {simulated} people")
            worn = tuple(dict.fromkeys(name for each in sets for name in each))
            walks = dict.fromkeys(sets, study.people(
                jax.random.key(seed), simulated, metres=metres, gait=gait, sensor=errors, placements=worn,
                rate_hz=max(c.rate_hz for c in choices),
            ))  # fmt: skip
        else:
            recording = recordings.only(file, recordings.how(rate, gyr_unit, acc_unit, None, format, place, trial))
            walks, body, reason = {}, options.person_of(person, options.given(None, height, thigh, shank)), ""
            for each in sets:  # those that the recording has
                try:
                    walks[each] = [study.own_truth(recording, study.Setup(each), body)]
                except RecordingError as error:
                    reason = str(error)
            if not walks:
                stop(f"{file}: {reason}")
        parts = []
        for number, choice in enumerate(c for c in choices if c.placements in walks):
            bar("set-ups", number, len(choices))
            parts.append(study.plan(walks[choice.placements], [choice], measure, people=people))
    table = pd.concat(parts, ignore_index=True)
    table = table.assign(name=[_name(row, choices) for row in table.to_dict("records")])
    table = table.sort_values("expected", na_position="last") if "expected" in table else table
    if not table["walks"].any():
        stop(f"no set-up can be used: {table['reason'].iloc[0]}")
    _show(table, measure, within, people)
    if figure is not None:
        figure.parent.mkdir(parents=True, exist_ok=True)
        what = file.name if file is not None else f"{simulated} simulated people"
        wrote([plot.save(plot.study(table, measure, within=within, title=what), figure)])
    write_json(json_file, {"measure": measure, "people": people, "setups": table.to_dict("records")})


def _places(text: str) -> tuple[str, ...]:
    """The placements of a text such as "feet+waist"; exits with code 2 for an unknown one."""
    names = [name for part in text.strip().split("+") for name in GROUPS.get(part, (part,))]
    for name in names:
        if name not in PLACEMENTS:
            stop(f"--places: there is no {name!r}; known are {', '.join((*GROUPS, *PLACEMENTS))}")
    return tuple(names)


def _numbers(option: str, text: str) -> list[float]:
    """Positive numbers of a text; exits with code 2 if it has others."""
    values = []
    with contextlib.suppress(ValueError):
        values = [float(part) for part in text.split(",")]
    if values and all(value > 0.0 for value in values):
        return values
    return stop(f"{option} is a list of positive numbers, such as 1,2; got {text!r}")


def _name(row: dict[Any, Any], choices: list[study.Setup]) -> str:
    """A set-up in words: its sensors and rate, and what differs among the set-ups."""
    groups = {names: word for word, names in GROUPS.items()}
    words = [groups.get(row["placements"], "+".join(row["placements"])), f"{row['rate_hz']:g} Hz"]
    shown = {
        "acc_range": lambda v: f"±{v / GRAVITY:g} g", "gyr_range": lambda v: f"±{math.degrees(v):g}°/s",
        "duty": lambda v: f"duty {100.0 * v:g} %", "seconds": lambda v: f"{v / 60.0:g} min",
    }  # fmt: skip
    words += [text(row[name]) for name, text in shown.items()
              if math.isfinite(row[name]) and len({getattr(c, name) for c in choices}) > 1]  # fmt: skip
    return ", ".join(words)


def _show(table: pd.DataFrame, measure: str, within: float | None, people: int) -> None:
    """Print the set-ups and the answer."""
    column, rows = QUANTITIES[measure], []
    factor, unit = (100.0, "cm") if column.unit == "m" else (1.0, column.shown)
    for row in table.to_dict("records"):
        if not row["walks"]:
            rows.append((row["name"], "–", *[""] * 5, printable(row["reason"], 60)))
            continue
        columns = ("expected", "bias", "sd", "stride_rmse")
        numbers = ["–" if math.isnan(row[name]) else f"{factor * row[name]:.2f}" for name in columns]
        numbers[0] += f" ± {factor * row['expected_sd']:.2f}" if row["expected_sd"] > 0.0 else ""
        covered = "–" if math.isnan(row["coverage"]) else f"{100.0 * row['coverage']:.0f} %"
        rows.append((row["name"], *numbers, covered, f"{1e3 * row['gyr_power']:.1f}", row["walks"]))
    head = ("set-up", f"expected [{unit}]", "bias", "people", "stride", "covered", "gyroscope [mW]", "walks")
    show(*head, rows=rows, title=f"{column.words}, mean of {people if people > 1 else 'each person'}")
    say(
        "expected: error of the mean, ± its standard deviation with so many walks; bias: mean error, which more people "
        "do not reduce; people: standard deviation of a person's error; stride: root mean square error of single "
        "strides; covered: strides within two of their stated deviations, 95 % if these are right; gyroscope: its mean "
        "power.", "dim",
    )  # fmt: skip
    best, *others = table[table["walks"] > 0].to_dict("records")
    alike = [row["name"] for row in others if row["expected"] - best["expected"]
             < 2.0 * math.hypot(row["expected_sd"], best["expected_sd"])]  # fmt: skip
    if alike:
        many = f"{best['walks']} people" if best["walks"] > 1 else "one walk"
        say(f"with {many} it cannot be said which is better, {best['name']}, or: {'; '.join(alike)}")
    if within is not None:
        enough = table[(table["walks"] > 0) & (table["expected"] <= within)]["name"]
        say(f"within {factor * within:g} {unit}: " + ("; ".join(enough) or "no set-up"))
