"""`jgait inspect`: what was understood of a file, before anything is computed from it."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from jgait import plot
from jgait.commands import recordings
from jgait.commands.console import say, say_failures, show, wrote
from jgait.events.rest import rest
from jgait.io.flags import GRADES
from jgait.notes import gravest_first, grouped, without_repeats
from jgait.report.page import significant
from jgait.signal.windows import true_runs
from jgait.types import Imu, Recording, as_float, reason_of


def inspect(
    files: Annotated[list[Path], typer.Argument(help="One recording each, as of jgait estimate.")],
    rate: recordings.Rate = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    range_unit: recordings.RangeUnit = "m",
    format: recordings.Format = None,
    place: recordings.Place = None,
    trial: recordings.Trial = None,
    out: Annotated[Path, typer.Option(help="Folder for the figures of the signals.")] = Path("jgait-results"),
) -> None:
    """Show what is understood of files: sensors, places, units, rate, losses and rest, and a figure of the signals.

    Nothing is estimated. Gravity at rest near 9.8 m/s² and rates of 100 to 800 deg/s say that the units are right.
    Files are read as by jgait estimate. Exit code 0: all files could be read; 1: some could not; 2: none.
    """
    how = recordings.how(rate, gyr_unit, acc_unit, range_unit, format, place, trial)
    made: list[Path] = []
    failures: list[tuple[str, str]] = []
    for file in files:
        try:
            recording = recordings.recording_of(file, **how)
        except (ValueError, OSError) as error:
            failures.append((file.name, reason_of(error)))
            continue
        _show(recording, file.name)
        out.mkdir(parents=True, exist_ok=True)
        made.append(plot.save(plot.signals(recording, title=file.name), out / f"{file.stem}_signals.png"))
    if made:
        wrote(made)
    say_failures(failures)
    if failures:
        raise typer.Exit(1 if made else 2)


def _show(recording: Recording, title: str) -> None:
    """Print a recording's sensors, a row each, and what was noticed about them."""
    times = [as_float(imu.time) for imu in recording.sensors.values()]
    duration = max(time[-1] for time in times) - min(time[0] for time in times)
    rate = recording.sampling_rate_hz
    show(
        "sensor", "at rest [%]", "gravity at rest [m/s²]", "largest rate [deg/s]", "lost [%]", "longest loss [s]",
        rows=[(name, *map(significant, of_sensor(imu, rate))) for name, imu in recording.sensors.items()],
        title=f"{title}: {duration:.1f} s at {rate:.5g} Hz",
    )  # fmt: skip
    for note in gravest_first(grouped(without_repeats(recording.notes))):
        say(f"{GRADES[note.severity]}: {note.text}")


def of_sensor(imu: Imu, rate_hz: float) -> tuple[float, ...]:
    """The numbers of a sensor's row; NaN where they are not known."""
    mask, gyr = np.asarray(imu.mask, bool), as_float(imu.gyr)
    rests = rest(gyr, np.zeros_like(gyr) if imu.acc is None else as_float(imu.acc), mask, rate_hz)
    losses = [end - start for start, end in true_runs(~mask)]
    return (
        100.0 * sum(end - start for start, end in rests.windows) / len(mask),
        rests.force if imu.acc is not None and rests.windows else float("nan"),
        float(np.rad2deg(np.linalg.norm(gyr[mask], axis=1).max(initial=0.0))),
        100.0 * float(np.mean(~mask)),
        max(losses, default=0) / rate_hz,
    )
