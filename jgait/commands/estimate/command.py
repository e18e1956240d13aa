"""`jgait estimate`: joint angles, foot paths, strides and widths of a user's own recordings."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from jgait.commands import recordings
from jgait.commands.console import Bar, console, errors, in_options, note, progress, stop, write_json
from jgait.commands.estimate import (
    duty as estimate_duty,
)
from jgait.commands.estimate import (
    feet as estimate_feet,
)
from jgait.commands.estimate import (
    legs as estimate_legs,
)
from jgait.commands.estimate import (
    strides as estimate_strides,
)
from jgait.commands.estimate import (
    waist as estimate_waist,
)
from jgait.commands.estimate.legs import Show
from jgait.commands.pipeline import pipeline_of, refuse_others, start_of
from jgait.types import Estimate, Recording


def estimate(
    files: Annotated[
        list[Path],
        typer.Argument(help="One recording each: CSV, Parquet, or as a measuring system writes it, also a folder."),
    ],
    estimator: Annotated[
        str,
        typer.Option(
            "--estimator",
            "--method",
            help="leg_ekf, foot_ins, stride_width_ekf, ankle_stride, waist_ofdri or duty_cycled_gyro.",
        ),
    ] = "leg_ekf",
    rate: Annotated[float | None, typer.Option(help="Samples a second [Hz]; needed without a time column.")] = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    range_unit: Annotated[str, typer.Option(help="Of the column feet_range: m, cm or mm.")] = "m",
    format: recordings.Format = None,
    place: recordings.Place = None,
    trial: recordings.Trial = None,
    thigh: Annotated[
        float | None,
        typer.Option(min=0.2, max=0.7, help="leg_ekf, duty_cycled_gyro: thigh length, hip to knee [m]; 0.43."),
    ] = None,
    shank: Annotated[
        float | None,
        typer.Option(min=0.2, max=0.7, help="leg_ekf, duty_cycled_gyro: shank length, knee to ankle [m]; 0.43."),
    ] = None,
    scale: Annotated[float | None, typer.Option(min=0.1, help="leg_ekf: personal scale of the distance; 1.")] = None,
    pivot: Annotated[
        float | None,
        typer.Option(min=0.0, max=0.3, help="Of feet: height of the sensor over the ball of the foot [m]; 0.08."),
    ] = None,
    level: Annotated[
        str | None,
        typer.Option(help="Of feet: whether the ground is level, yes, no, or auto to be told by the strides."),
    ] = None,
    range_offset: Annotated[
        float | None,
        typer.Option(min=-0.2, max=0.4, help="stride_width_ekf: what the feet are farther apart than the range [m]."),
    ] = None,
    lever: Annotated[
        float | None,
        typer.Option(
            min=-0.05,
            max=0.2,
            help="ankle_stride: height of the sensor over the ankle [m]; 0.03 at the ankle, 0.18 on the shank.",
        ),
    ] = None,
    axes: Annotated[
        str | None,
        typer.Option(
            help="ankle_stride: which of the sensor's axes should look forward, left and up, such as x,y,z; only to "
            "notice sensors that are upside down or on the other leg."
        ),
    ] = None,
    height: Annotated[
        float | None, typer.Option(min=0.8, max=2.4, help="waist_ofdri: height of the person [m].")
    ] = None,
    sensor_height: Annotated[
        float | None,
        typer.Option(min=0.4, max=1.6, help="waist_ofdri: height of the sensor above the ground [m]; 0.97."),
    ] = None,
    duty: Annotated[
        float | None,
        typer.Option(
            help="duty_cycled_gyro: part of the time that the shank's gyroscope is on, in tenths, 0.1 to 1; the other "
            "samples are hidden as if it slept."
        ),
    ] = None,
    filler: Annotated[
        str | None,
        typer.Option(
            help="duty_cycled_gyro: how gaps are filled, such as neighbours or blend; a wrong name lists all."
        ),
    ] = None,
    warm_up: Annotated[
        float | None,
        typer.Option(min=0.0, help="duty_cycled_gyro: how long all gyroscopes are on at first [s]; 0."),
    ] = None,
    params: Annotated[Path | None, typer.Option(help="Parameters from this file, as `jgait tune` writes it.")] = None,
    paper: Annotated[bool, typer.Option("--paper", help="The paper's pipeline instead of the best one.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for tables and figures.")] = Path("jgait-results"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the numbers here.")] = None,
) -> None:
    """Joint angles (leg_ekf), ways and strides of the feet (foot_ins), those of both with widths (stride_width_ekf),
    strides of a leg (ankle_stride), contacts and distance from the waist (waist_ofdri), or joint angles while
    gyroscopes sleep part of the time (duty_cycled_gyro, with the columns of leg_ekf or one segment's alone).

    Columns: time [s], and for each sensor thigh_right_gyr_x … thigh_right_acc_z, likewise shank_right, thigh_left,
    shank_left. One leg is enough; accelerometers make the angles stay true in turns and on long walks. For the feet
    foot_right_gyr_x … foot_left_acc_z, one foot or both, and for widths feet_range [m], the distance between the feet,
    empty where nothing was heard. For ankle_stride ankle_right_gyr_x … shank_left_acc_z, one leg or both; for
    waist_ofdri waist_gyr_x … waist_acc_z (or lower_back, or pelvis); both mounted in any way. The person should stand
    still for a second or more somewhere in the recording.
    """
    pipeline, settings = pipeline_of(estimator, paper), None
    refuse_others(estimator, {
        "--thigh": thigh, "--shank": shank, "--scale": scale, "--pivot": pivot, "--level": level,
        "--range-offset": range_offset, "--lever": lever, "--axes": axes, "--height": height,
        "--sensor-height": sensor_height, "--duty": duty, "--filler": filler, "--warm-up": warm_up,
    })  # fmt: skip
    if estimator == "duty_cycled_gyro":
        settings = estimate_duty.options_of(duty, filler, warm_up, paper)
        pipeline = estimate_duty.pipeline(settings)
    start, told = start_of(pipeline, params, paper), params is not None
    if estimator == "leg_ekf":
        show: Show = estimate_legs.legs(start, thigh, shank, scale, paper, told=told)
    elif estimator in ("foot_ins", "stride_width_ekf"):
        show = estimate_feet.feet(estimator, start, pivot, level, range_offset, paper, told=told)
    elif estimator == "ankle_stride":
        show = estimate_strides.strides(start, lever, axes, told=told)
    elif estimator == "waist_ofdri":
        show = estimate_waist.walks(start, height, sensor_height, paper, told=told)
    elif estimator == "duty_cycled_gyro":
        show = estimate_duty.gyroscopes(start, settings, thigh, shank)
    else:
        stop(
            "jgait estimate shows what leg_ekf, foot_ins, stride_width_ekf, ankle_stride, waist_ofdri and "
            "duty_cycled_gyro give; "
            f"for {estimator} use jgait evaluate"
        )

    placement, placements = recordings.places_of(place)
    read = partial(
        recordings.recording_of, rate=rate, gyr_unit=gyr_unit, acc_unit=acc_unit, range_unit=range_unit, format=format,
        placement=placement, placements=placements, trial=trial,
    )  # fmt: skip
    numbers, failures = _each(files, read, show, out)
    if show.table.rows:
        console.print(show.table)
        console.print(show.caption, style="dim")
    write_json(json_file, {"estimator": estimator, "recordings": numbers, "failures": failures})
    if failures:
        errors.print(f"{len(failures)} of {len(files)} recordings could not be used", highlight=False)
        raise typer.Exit(1 if len(failures) < len(files) else 2)


def _each(
    files: list[Path], read: Callable[[Path], Recording], show: Show, out: Path
) -> tuple[dict[str, Any], dict[str, str]]:
    """Every file estimated, written and put into the table: file → numbers, and file → why it could not be used."""
    numbers: dict[str, Any] = {}
    failures: dict[str, str] = {}
    for file in files:
        try:
            with progress() as bars:
                Bar(bars)(f"{file.name}: reading and computing; the first recording takes longest", 0, None)
                recording = read(file)
                result = show.run(recording)
            result = _with_notes(result, recording)
        except (ValueError, OSError) as error:
            reason = in_options(str(error))
            errors.print(f"[bold red]{escape(str(file))}:[/] {escape(reason)}", highlight=False, soft_wrap=True)
            failures[str(file)] = reason
            continue
        try:
            out.mkdir(parents=True, exist_ok=True)
            written = show.write(result, out, file.stem)
        except OSError as error:
            stop(f"nothing more could be written to {out}: {error}")
        for told in result.diagnostics["notes"]:
            note(f"{file.name}: {told}")
        for row in show.rows(result, file.stem):
            show.table.add_row(*row)
        numbers[str(file)] = {**_numbers(result, written), **({} if show.numbers is None else show.numbers(result))}
        console.print("wrote " + ", ".join(str(path) for path in written), soft_wrap=True)
    return numbers, failures


def _with_notes(result: Estimate, recording: Recording) -> Estimate:
    """What the reader noticed first, whatever the estimator repeats of it."""
    own = result.diagnostics["notes"]
    read = tuple(said for said in recording.notes if said not in own)
    return result._replace(diagnostics={**result.diagnostics, "notes": (*read, *own)})


def _numbers(result: Estimate, written: list[Path]) -> dict[str, Any]:
    """What the JSON file says of every recording, whatever the estimator."""
    way = None if result.distance is None else float(result.distance[-1])
    return {
        "duration_s": float(result.time[-1] - result.time[0]),
        "distance_m": way,
        "notes": list(result.diagnostics["notes"]),
        "files": [str(path) for path in written],
    }
