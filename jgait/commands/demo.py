"""`jgait demo`: a real walk by one call, beside its reference; then tune on one part of it, and judge on another."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from jgait import datasets
from jgait.commands import demo_run
from jgait.commands.console import Bar, console, progress, stop, table_of, write_json, wrote
from jgait.commands.demo_run import Demo
from jgait.commands.folder import results_folder


def _show(result: Demo) -> None:
    """Print the errors and the tuned parameters of a demonstration."""
    table = table_of("walk", "leg", "error", "default", "tuned", left=3, title=result.title)
    last = None
    for line in result.lines:
        walk = f"{line.walk} ({'tuned on' if line.tuned_on else 'not tuned on'})"
        table.add_row(
            walk if walk != last else "", line.leg, line.what, *(f"{v:.2f}" for v in (line.before, line.after))
        )
        last = walk
    console.print(table)
    moved = ", ".join(f"{name} {before:.3g} → {after:.3g}" for name, (before, after) in result.tuned.items())
    console.print(f"tuned by gradient ({len(result.losses)} steps, loss {result.losses[0]:.1f} → "
                  f"{min(result.losses):.1f}): {moved}", highlight=False)  # fmt: skip


def demo(
    dataset: Annotated[
        str,
        typer.Option(
            help="auto: neura_sparse if it is there, else simulated; neura_sparse: fetched if need be; simulated."
        ),
    ] = "auto",
    out: Annotated[Path, typer.Option(help="Folder for the figures.")] = Path("jgait-demo"),
    subjects: Annotated[int, typer.Option(min=2, help="Simulated people.")] = 6,
    steps: Annotated[int, typer.Option(min=1, help="Steps of the optimiser.")] = 30,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the numbers here.")] = None,
) -> None:
    """A real walk by one call, with its report; then tune by gradient on one part of it, and judge on another part.

    Where the recording is not there, simulated people are tuned on, and others are judged.
    """
    if dataset not in ("auto", "simulated", "neura_sparse"):
        stop(f"--dataset is auto, simulated or neura_sparse; got '{dataset}'")
    if dataset == "neura_sparse" and not datasets.available("neura_sparse"):
        try:
            datasets.fetch("neura_sparse", progress=True)
        except Exception as error:
            stop(f"neura_sparse could not be fetched: {error}")
    real = dataset != "simulated" and datasets.available("neura_sparse")
    # Most of the time goes into compiling, which two threads do side by side.
    with (
        results_folder(out, "demo", {}, json_file=json_file) as folder,
        progress() as bars,
        ThreadPoolExecutor(2) as pool,
    ):
        walk = pool.submit(demo_run.real_walk, folder.stage, Bar(bars)) if real else None
        if real:
            tuning = pool.submit(demo_run.neura_sparse, folder.stage, Bar(bars), steps=steps)
        else:
            tuning = pool.submit(demo_run.simulated, folder.stage, Bar(bars), subjects=subjects, steps=steps)
        first = None if walk is None else walk.result()
        result = tuning.result()
        figures = folder.publish([*([] if first is None else first.figures), *result.figures])
    if first is not None:
        table = table_of("quantity", "all sensors", "each alone", "motion capture", left=4, title=first.title)
        for line in first.lines:
            table.add_row(*map(escape, line))
        console.print(table)
        console.print()
    console.print("Errors are root mean squares relative to standing; of the distance, the signed or median error.\n")
    _show(result)
    console.print()
    if first is None and dataset == "auto":
        console.print(
            "neura_sparse (real walks with motion capture) is not here: jgait demo --dataset neura_sparse fetches it"
        )
    wrote(figures)
    rows: dict[str, Any] = {} if first is None else {first.title: first.numbers}
    rows[result.title] = {"lines": [line._asdict() for line in result.lines], "tuned": result.tuned}
    write_json(json_file, rows)
