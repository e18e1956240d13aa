"""`jgait demo`: a real walk by one call beside its reference; then tune by gradient, and judge on other people."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from jgait import datasets
from jgait.commands import jobs, report
from jgait.commands.console import console, refused, show_table, stop, write_json, wrote
from jgait.commands.datasets import download
from jgait.commands.folder import results_folder
from jgait.report.page import Table

PAGE = "real_walk.html"
SHOWN = ("What each sensor says", "Against the reference", report.MOVED)


def demo(
    context: typer.Context,
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
        with refused("", Exception):
            download("neura_sparse")
    numbers: dict[str, Any] = {}
    if dataset != "simulated" and datasets.available("neura_sparse"):
        walk = datasets.load("neura_sparse")[0]
        words = ["report", "--dataset", "neura_sparse", "--recording", walk.recording.name]
        _say([*words, "--out", str(out / PAGE)])
        with results_folder(out, "demo", {}, planned=[PAGE], json_file=json_file) as folder:
            page = report.of_walk(walk, jobs.all_sensors({}), "neura_sparse", shlex.join(["jgait", *words]))
            wrote(folder.publish([page.save(folder.stage / PAGE)]))
        for section in page.sections:
            for part in section.parts:
                if section.heading in SHOWN and isinstance(part, Table):
                    show_table(part, section.heading)
        numbers = page.numbers
    elif dataset == "auto":
        console.print("neura_sparse (real walks with motion capture) is not here: --dataset neura_sparse fetches it")
    people, tuned = ["--simulated", str(subjects)], str(out / "tuned")
    learn = ["--free", "standing_hip,standing_knee,distance_scale", "--loss", "trajectory,distance"]
    judge = ["evaluate", *people, "--seed", "1"]
    for words in (
        ["tune", *people, *learn, "--steps", str(steps), "--no-cross-validation", "--out", tuned],
        [*judge, "--out", str(out / "default")],
        [*judge, "--params", f"{tuned}/tuned.json", "--out", str(out / "others")],
    ):
        _say(words)
        # a user does not need --fresh in a new folder
        if code := context.find_root().command.main([*words, "--fresh"], standalone_mode=False):
            raise typer.Exit(code)
    write_json(json_file, numbers)


def _say(words: list[str]) -> None:
    console.print(f"\n$ jgait {shlex.join(words)}", style="bold", markup=False, soft_wrap=True)
