"""Reading a user's file for a command: its format, its units, and the placements of its sensors."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from jaxtyping import PyTree

from jgait import io
from jgait.commands.console import refused, stop
from jgait.io.formats import columns
from jgait.io.names import NOT_USED, no_placement
from jgait.types import PLACEMENTS, Recording, RecordingError, reason_of

Rate = Annotated[float | None, typer.Option(help="Samples a second [Hz]; needed without a time column.")]
RangeUnit = Annotated[str, typer.Option(help="Of the column feet_range: m, cm or mm.")]
GyrUnit = Annotated[
    str | None,
    typer.Option(help="deg/s, rad/s, mdeg/s or mrad/s; default what the file states, for tables else deg/s."),
]
AccUnit = Annotated[
    str | None, typer.Option(help="m/s^2, g or mg; default what the file states, for tables else m/s^2.")
]
Format = Annotated[
    str | None,
    typer.Option("--format", help="Of the files, where it is not detected correctly; a wrong name lists all."),
]
Place = Annotated[
    list[str] | None,
    typer.Option(
        "--place",
        help="Where a sensor sat: SENSOR=shank_right with the sensor's name in the file, once for each; SENSOR=none "
        "leaves it out; or shank_right alone for files of one sensor.",
    ),
]
Trial = Annotated[
    str | None, typer.Option(help="Of a Mobilise-D file with several trials, such as TimeMeasure1/Test5/Trial1.")
]

OPTIONS = {
    "sampling_rate_hz": "--rate", "time_unit": "the unit in the name of the time column", "gyr_unit": "--gyr-unit",
    "acc_unit": "--acc-unit", "range_unit": "--range-unit", "format": "--format", "placement": "--place",
    "placements": "--place", "trial": "--trial",
}  # fmt: skip
"""Argument of a reader → the option of the same meaning."""


def _in_options(error: RecordingError, options: Mapping[str, str], *names: str) -> RecordingError:
    """The error, with the command's option instead of the reader's argument, and without the recording's names."""
    option = options.get(error.argument, error.argument)
    if isinstance(error.value, dict):
        between = "' '" if option.startswith("--") else "; "  # a column has all in its cell
        option += f" '{between.join(f'{sensor}={place}' for sensor, place in error.value.items())}'"
    elif error.value:
        option += f" {error.value}"
    elif error.argument == "placements":
        option += " SENSOR=PLACE"
    text = error.with_argument(option)
    for name in names:
        if text.startswith(f"{name} "):  # the command prints the file's name before it
            text = f"it {text.removeprefix(f'{name} ')}"
        text = text.removeprefix(f"{name}: ").removeprefix(f"{name}, ")
    return RecordingError(text)


def places_in(texts: Iterable[str]) -> dict[str, Any]:
    """The placement for files of one sensor, and sensor → placement. Raises ValueError for any other text."""
    pairs = [text.rpartition("=")[::2] for text in texts]
    for sensor, where in pairs:
        if where not in PLACEMENTS and not (sensor and where == NOT_USED):
            raise ValueError(no_placement(where))
    alone = [where for sensor, where in pairs if not sensor]
    places = {sensor: where for sensor, where in pairs if sensor}
    if alone and places:
        raise ValueError("give SENSOR=PLACE for each sensor, or a placement alone for files of one sensor; got both")
    if len(alone) > 1:
        raise ValueError(f"without the sensor’s name there can be one placement; got {' and '.join(alone)}")
    return {"placement": alone[0] if alone else None, "placements": places}


class Item(NamedTuple):
    """One recording of a file."""

    file: Path  #: the file or folder.
    name: str  #: first part of the names of its results.
    #: name of the trial in a file with several; None: the file is one recording, or the reader decides.
    trial: str | None = None
    folder: str = ""  #: names of the file's folders that tell it from another of the same name; else empty.
    table: Path | None = None  #: the table of recordings that lists the file.
    cell: str = ""  #: the file as the table names it.
    subject: str = ""  #: the person by the table.

    @property
    def key(self) -> str:
        """The file, with its trial if it has several."""
        return f"{self.file}: {self.trial}" if self.trial else str(self.file)

    @property
    def label(self) -> str:
        """As `key`, with the folders only that tell the file from another one."""
        shown = self.cell or str(Path(self.folder) / self.file.name)
        return f"{shown}: {self.trial}" if self.trial else shown

    @property
    def recording(self) -> str:
        """The recording in tables of several: the file as its table names it, else as the results of each begin."""
        return self.label if self.cell else self.name


def trials_of(file: Path, name: str, format: str | None, trial: str | None) -> list[Item]:
    """The recordings of a file: every trial of a Mobilise-D file, or the one that is asked for; else the file."""
    try:
        trials = io.mobilised_trials(file) if file.is_file() and (format or io.format_of(file)) == "mobilised" else ()
    except (OSError, ValueError):  # the reader will say what is wrong
        trials = ()
    chosen = [each for each in trials if trial in (None, each)] or [
        each for each in trials if each.endswith(f"/{trial}")
    ]
    if len(trials) < 2 or not chosen or (trial is not None and len(chosen) > 1):
        return [Item(file, name, trial)]
    return [Item(file, f"{name}_{each.replace('/', '_')}", each) for each in chosen]


def how(
    rate: float | None, gyr_unit: str | None, acc_unit: str | None, range_unit: str | None, format: str | None,
    place: list[str] | None, trial: str | None = None,
) -> dict[str, Any]:  # fmt: skip
    """The arguments of `recording_of` that the options of this module state; exits with code 2 for a wrong place."""
    given = {
        "rate": rate, "gyr_unit": gyr_unit, "acc_unit": acc_unit, "range_unit": range_unit, "format": format,
        "trial": trial,
    }  # fmt: skip
    with refused("--place: "):
        places = places_in(place or ())
    return {name: value for name, value in given.items() if value is not None} | places


def only(file: Path, how: Mapping[str, Any]) -> Recording:
    """The recording of a command that has one; exits with code 2 if it cannot be used."""
    try:
        return recording_of(file, **how)
    except Exception as error:
        stop(f"{file}: {reason_of(error)}")


def recording_of(
    file: Path, *, rate: float | None = None, gyr_unit: str | None = None, acc_unit: str | None = None,
    range_unit: str = "m", format: str | None = None, placement: str | None = None,
    placements: Mapping[str, str] | None = None, trial: str | None = None, options: Mapping[str, str] = OPTIONS,
    **called: PyTree,
) -> Recording:  # fmt: skip
    """A recording from a user's file or folder, as the options state it; `called` are `name` and `subject`. Messages
    have `options` in place of the reader's arguments.

    Raises OSError if the file cannot be read, ValueError for unknown units or formats or an unusable recording.
    """
    given: dict[str, Any] = {"gyr_unit": gyr_unit and gyr_unit.lower(), "acc_unit": acc_unit and acc_unit.lower()}
    given |= {"sampling_rate_hz": rate, "placement": placement, **called}
    try:
        kind = format or (io.format_of(file) if file.exists() else "csv")
        if trial is not None:
            if kind != "mobilised":
                raise ValueError(f"{file.name} is no Mobilise-D file, so there is no trial {trial!r} in it")
            return io.read_mobilised(file, trial=trial, **called)
        text = kind == "csv" and not file.is_dir() and file.suffix.lower() in (".csv", ".tsv", ".txt")
        if text and not placements and not (file.exists() and columns.foreign(file)):
            return io.read_csv(file, range_unit=range_unit, **given)
        return io.read(file, format=kind, placements=placements or None, **given)
    except FileNotFoundError as error:  # commands print the file before the error
        raise FileNotFoundError("there is no such file") from error
    except RecordingError as error:
        raise _in_options(error, options, called.get("name") or file.stem, file.name) from error
