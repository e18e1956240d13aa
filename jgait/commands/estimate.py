"""`jgait estimate`: joint angles, foot path and distance of a user's own recordings."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from jgait.commands.console import console, errors, note, stop
from jgait.commands.pipeline import pipeline_of, start_of
from jgait.types import SIDES


def estimate(
    files: Annotated[list[Path], typer.Argument(help="CSV files, one recording each.")],
    rate: Annotated[float | None, typer.Option(help="Samples a second [Hz]; needed without a time column.")] = None,
    gyr_unit: Annotated[str, typer.Option(help="deg/s or rad/s.")] = "deg/s",
    acc_unit: Annotated[str, typer.Option(help="m/s^2 or g.")] = "m/s^2",
    thigh: Annotated[float | None, typer.Option(min=0.2, max=0.7, help="Thigh length, hip to knee [m]; 0.43.")] = None,
    shank: Annotated[
        float | None, typer.Option(min=0.2, max=0.7, help="Shank length, knee to ankle [m]; 0.43.")
    ] = None,
    scale: Annotated[float | None, typer.Option(min=0.1, help="Personal scale of the distance; 1.")] = None,
    params: Annotated[Path | None, typer.Option(help="Parameters from this file, as `jgait tune` writes it.")] = None,
    paper: Annotated[bool, typer.Option("--paper", help="The paper's pipeline instead of the best one.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for tables and figures.")] = Path("jgait-results"),
) -> None:
    """Hip and knee angles, foot path and distance from thigh and shank sensors in CSV files.

    Columns: time [s], and for each sensor thigh_right_gyr_x … thigh_right_acc_z, likewise shank_right, thigh_left,
    shank_left. One leg is enough; accelerometers make the angles stay true in turns and on long walks. The person
    should stand still for a second or more somewhere in the recording.
    """
    from jgait import io, plot
    from jgait.estimators import leg_ekf

    p = start_of(pipeline_of("leg_ekf", paper), params, paper)
    known = {"thigh_length": thigh, "shank_length": shank}
    missing = [f"--{name.removesuffix('_length')}" for name, value in known.items() if value is None]
    if missing and params is None:
        note(
            f"no {' and '.join(missing)}: the default length of 0.43 m is taken, and distances are in proportion to it"
        )
    p = leg_ekf.with_body(p, {name: value for name, value in known.items() if value is not None})
    p = p if scale is None else p._replace(distance_scale=scale)
    failed = 0
    table = Table(title="leg_ekf, the paper's pipeline" if paper else "leg_ekf", title_justify="left")
    for name in (
        "recording",
        "duration [s]",
        "distance [m]",
        *(f"{j} {s} [°]" for s in SIDES for j in ("hip", "knee")),
    ):
        table.add_column(name, justify="left" if name == "recording" else "right")
    for file in files:
        try:
            recording = io.read_csv(file, sampling_rate_hz=rate, gyr_unit=gyr_unit, acc_unit=acc_unit)
            result = leg_ekf.estimate(p, recording, leg_ekf.PAPER if paper else leg_ekf.DEFAULT)
        except (ValueError, OSError) as error:
            errors.print(f"[bold red]{file}:[/] {error}", highlight=False)
            failed += 1
            continue
        try:
            out.mkdir(parents=True, exist_ok=True)
            written = [
                io.write_csv(result, out / f"{file.stem}_legs.csv"),
                plot.save(plot.joint_angles(result, title=file.stem), out / f"{file.stem}_angles.png"),
                plot.save(plot.foot_path(result, title=file.stem), out / f"{file.stem}_foot_path.png"),
                plot.save(plot.distance(result, title=file.stem), out / f"{file.stem}_distance.png"),
            ]
        except OSError as error:
            stop(f"nothing more could be written to {out}: {error}")
        for told in result.diagnostics["notes"]:
            note(f"{file.name}: {told}")
        _summarise(table, file, result)
        console.print("wrote " + ", ".join(str(path) for path in written), soft_wrap=True)
    if table.rows:
        console.print(table)
        console.print("angles: smallest … largest flexion", style="dim")
    if failed:
        errors.print(f"{failed} of {len(files)} recordings could not be used", highlight=False)
        raise typer.Exit(1 if failed < len(files) else 2)


def _summarise(table: Table, file: Path, result: Any) -> None:
    import numpy as np

    cells = [file.stem, f"{result.time[-1] - result.time[0]:.1f}", f"{result.distance[-1]:.2f}"]
    for leg in result.legs:
        for values in (None, None) if leg is None else (leg.hip_angle, leg.knee_angle):
            if values is None:
                cells.append("–")
            else:
                low, high = np.degrees([np.min(values), np.max(values)])
                cells.append(f"{low:.0f} … {high:.0f}")
    table.add_row(*cells)
