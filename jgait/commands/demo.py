"""`jgait demo`: a real walk by one call beside its reference; then tune by gradient, and judge on other people."""

from pathlib import Path
from typing import Annotated, Any

import typer

from jgait import datasets
from jgait.commands import jobs, report
from jgait.commands.console import console, show_table, stop, write_json, wrote
from jgait.commands.datasets import download
from jgait.commands.evaluate import evaluate
from jgait.commands.folder import results_folder
from jgait.commands.tune import tune
from jgait.report.page import Table

PAGE = "real_walk.html"


def demo(
    dataset: Annotated[
        str,
        typer.Option(help="auto: neura_sparse too if it is there; neura_sparse: fetched if need be; simulated: alone."),
    ] = "auto",
    out: Annotated[Path, typer.Option(help="Folder for the page, tables and figures.")] = Path("jgait-demo"),
    subjects: Annotated[int, typer.Option(min=2, help="Simulated people who are learned from, and as many others.")] = (
        6
    ),
    steps: Annotated[int, typer.Option(min=1, help="Largest number of steps of the optimiser.")] = 30,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the numbers of the real walk here.")] = None,
) -> None:
    """A real walk by one call, with its report; then what users call next: tune on people, and evaluate on others.

    Each part is a command, which is printed first, so that it can be repeated with files of your own.
    """
    if dataset not in ("auto", "simulated", "neura_sparse"):
        stop(f"--dataset is auto, simulated or neura_sparse; got '{dataset}'")
    if dataset == "neura_sparse" and not datasets.available("neura_sparse"):
        try:
            download("neura_sparse")
        except Exception as error:
            stop(str(error))
    numbers: dict[str, Any] = {}
    if dataset != "simulated" and datasets.available("neura_sparse"):
        walk = datasets.load("neura_sparse")[0]
        command = f"jgait report --dataset neura_sparse --recording {walk.recording.name}"
        _say(f"{command} --out {out / PAGE}")
        with results_folder(out, "demo", {}, planned=[PAGE], json_file=json_file) as folder:
            page = report.of_walk(walk, jobs.all_sensors({}), "neura_sparse", command)
            wrote(folder.publish([page.save(folder.stage / PAGE)]))
        for section in page.content.sections:
            for part in section.parts:
                if section.heading in ("What each sensor says", "Against the reference") and isinstance(part, Table):
                    show_table(part, section.heading)
        numbers = page.numbers
    elif dataset == "auto":
        console.print("neura_sparse (real walks with motion capture) is not here: --dataset neura_sparse fetches it")
    free, loss, tuned = "standing_hip,standing_knee,distance_scale", "trajectory,distance", out / "tuned"
    how = f"--steps {steps} --no-cross-validation"
    _say(f"jgait tune --simulated {subjects} --free {free} --loss {loss} {how} --out {tuned}")
    tune(free, simulated=subjects, loss=loss, steps=steps, cross=False, out=tuned, fresh=True)
    for name, params in (("default", None), ("others", tuned / "tuned.json")):
        given = "" if params is None else f" --params {params}"
        _say(f"jgait evaluate --simulated {subjects} --seed 1{given} --out {out / name}")
        evaluate(simulated=subjects, seed=1, params=params, out=out / name, fresh=True)
    write_json(json_file, numbers)


def _say(command: str) -> None:
    console.print(f"\n$ {command}", style="bold", markup=False, soft_wrap=True)
