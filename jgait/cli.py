"""The command line: `jgait demo`, `jgait estimate`, `jgait datasets`."""

import json
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any, NoReturn

try:
    import typer
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.table import Table
except ImportError as missing:  # the library alone does without them
    print(f"the jgait command needs its extra: pip install 'jgait[cli]' ({missing})", file=sys.stderr)
    raise SystemExit(1) from missing

import jax

from jgait.types import SIDES

app = typer.Typer(
    help="Gait from wearable sensors: estimate, tune by gradient, judge.", no_args_is_help=True, add_completion=False
)
sets = typer.Typer(help="Public recordings with a reference.", no_args_is_help=True)
app.add_typer(sets, name="datasets")
console = Console()
errors = Console(stderr=True)


def main() -> None:
    """Run the command line: float64, and compiled programs kept between runs."""
    jax.config.update("jax_enable_x64", True)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jgait" / "compiled"
    try:
        cache.mkdir(parents=True, exist_ok=True)
    except OSError:
        pass  # no place to keep them: every run compiles anew
    else:
        jax.config.update("jax_compilation_cache_dir", str(cache))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    app()


def _stop(message: str) -> NoReturn:
    errors.print(f"[bold red]jgait:[/] {message}", highlight=False, markup=True)
    raise typer.Exit(2)


class _Bar:
    """One progress bar that follows whatever is being done."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.task = progress.add_task("starting", total=None)

    def __call__(self, what: str, done: int, total: int) -> None:
        self.progress.update(self.task, description=what, completed=done, total=total)


def _progress() -> Progress:
    return Progress(
        TextColumn("{task.description}"), BarColumn(bar_width=30), TimeElapsedColumn(), console=errors, transient=True
    )


def _show(result: Any) -> None:
    table = Table(title=result.title, title_justify="left", caption_justify="left")
    paper = any(line.paper is not None for line in result.lines)
    for name in ("walk", "leg", "error"):
        table.add_column(name)
    for name in (*(["paper's pipeline"] if paper else []), "default", "tuned"):
        table.add_column(name, justify="right")
    last = None
    for line in result.lines:
        walk = f"{line.walk} ({'tuned on' if line.seen else 'never seen'})"
        values = [line.before, line.after] if not paper else [line.paper, line.before, line.after]
        table.add_row(
            walk if walk != last else "", line.leg, line.what, *("–" if v is None else f"{v:.2f}" for v in values)
        )
        last = walk
    console.print(table)
    moved = ", ".join(f"{name} {before:.3g} → {after:.3g}" for name, (before, after) in result.tuned.items())
    console.print(f"tuned by gradient ({len(result.losses)} steps, loss {result.losses[0]:.1f} → "
                  f"{min(result.losses):.1f}): {moved}", highlight=False)  # fmt: skip


@app.command()
def demo(
    dataset: Annotated[
        str, typer.Option(help="auto, simulated or neura_sparse; neura_sparse is fetched if it is not there.")
    ] = "auto",
    out: Annotated[Path, typer.Option(help="Folder for the figures.")] = Path("jgait-demo"),
    subjects: Annotated[int, typer.Option(min=2, help="Simulated people.")] = 6,
    steps: Annotated[int, typer.Option(min=1, help="Steps of the optimiser.")] = 15,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the numbers here.")] = None,
) -> None:
    """Estimate joint angles, compare with the truth, tune by gradient, judge on walks the tuning never saw."""
    from jgait import datasets
    from jgait import demo as demonstration

    if dataset not in ("auto", "simulated", "neura_sparse"):
        _stop(f"--dataset is auto, simulated or neura_sparse; got '{dataset}'")
    if dataset == "neura_sparse" and not datasets.available("neura_sparse"):
        try:
            datasets.fetch("neura_sparse", progress=True)
        except Exception as error:
            _stop(f"neura_sparse could not be fetched: {error}")
    parts: list[Callable[[Any], Any]] = [lambda bar: demonstration.simulated(out, bar, subjects=subjects, steps=steps)]
    if dataset == "neura_sparse" or (dataset == "auto" and datasets.available("neura_sparse")):
        parts.append(lambda bar: demonstration.neura_sparse(out, bar, steps=steps))
    # Most of the time goes into compiling, which two threads do side by side.
    with _progress() as progress, ThreadPoolExecutor(len(parts)) as pool:
        running = [pool.submit(part, _Bar(progress)) for part in parts]
        try:
            results = [one.result() for one in running]
        except OSError as error:
            _stop(f"the figures could not be written to {out}: {error}")
    console.print("Errors are root mean squares relative to standing; of the distance, the signed or median error.\n")
    for result in results:
        _show(result)
        console.print()
    if len(results) == 1 and dataset == "auto":
        console.print(
            "neura_sparse (real walks with motion capture) is not here: jgait demo --dataset neura_sparse fetches it"
        )
    console.print("figures: " + ", ".join(str(path) for result in results for path in result.figures), soft_wrap=True)
    if json_file is not None:
        rows = {r.title: {"lines": [line._asdict() for line in r.lines], "tuned": r.tuned} for r in results}
        json_file.write_text(json.dumps(rows, indent=1) + "\n")


@app.command()
def estimate(
    files: Annotated[list[Path], typer.Argument(help="CSV files, one recording each.")],
    rate: Annotated[float | None, typer.Option(help="Samples a second [Hz]; needed without a time column.")] = None,
    gyr_unit: Annotated[str, typer.Option(help="deg/s or rad/s.")] = "deg/s",
    acc_unit: Annotated[str, typer.Option(help="m/s^2 or g.")] = "m/s^2",
    thigh: Annotated[float, typer.Option(min=0.2, max=0.7, help="Thigh length, hip to knee [m].")] = 0.43,
    shank: Annotated[float, typer.Option(min=0.2, max=0.7, help="Shank length, knee to ankle [m].")] = 0.43,
    scale: Annotated[float, typer.Option(min=0.1, help="Personal scale of the distance.")] = 1.0,
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

    p = leg_ekf.LegParams(
        thigh_length=leg_ekf.BySide(thigh, thigh), shank_length=leg_ekf.BySide(shank, shank), distance_scale=scale
    )
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
            _stop(f"nothing more could be written to {out}: {error}")
        for note in result.diagnostics["notes"]:
            errors.print(f"{file.name}: {note}", highlight=False, style="yellow")
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


@sets.command("list")
def list_sets() -> None:
    """The public data sets that jgait reads, and which of them are here."""
    from jgait import datasets

    table = Table("set", "here", "licence", "cite")
    for name in datasets.list_datasets():
        about = datasets.info(name)
        table.add_row(name, "yes" if datasets.available(name) else "no", about.licence, about.citation)
    console.print(table)


@sets.command("path")
def path_of_set(name: str) -> None:
    """The folder in which a data set lies."""
    from jgait import datasets

    try:
        console.print(str(datasets.path(name)), soft_wrap=True)
    except (datasets.DatasetUnavailable, ValueError) as error:
        _stop(str(error))


@sets.command("fetch")
def fetch_set(name: str) -> None:
    """Download a data set from its authors, each file checked by its hash."""
    from jgait import datasets

    try:
        console.print(str(datasets.fetch(name, progress=True)), soft_wrap=True)
    except Exception as error:
        _stop(f"{name} could not be fetched: {error}")


if __name__ == "__main__":
    main()
