"""`jgait join`: the parts of a command, made by the jobs of an array, put together."""

import json
import shutil
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import typer

from jgait.commands.console import count, refused, stop
from jgait.commands.folder import run_of
from jgait.commands.machines import COMMAND, PARTS, JobPart


def join(
    context: typer.Context,
    out: Annotated[Path, typer.Argument(help="The folder that was --out of all parts.")],
) -> None:
    """Put the parts of jgait estimate, evaluate or tune --part K/N together: the files that one run writes.

    Parts that are missing, did not end, or are of other arguments are named, and nothing is joined. The command of the
    parts is given again without --part, in the folder in which it was given, and finds the work done. Exit code: that
    of the command.
    """
    made = _checked(out)
    command, *words = next(iter(made.values()))[COMMAND]
    target = run_of(out, command)
    with refused(f"{out}: "):
        target.mkdir(exist_ok=True)
        for part in made:
            for entry in sorted(run_of(part.place(out), command).glob("[!.]*")):
                # Each part numbers its batches from 0 as the process 0.
                there = target / entry.name.replace("part-0-", f"part-{part.number}-", 1)
                if not there.exists():
                    entry.rename(there)
                elif entry.name.startswith("part-0-") or entry.is_dir():
                    stop(f"{there} is there: {out} holds results of part {part} already; give another --out")
                elif entry.read_bytes() != there.read_bytes():
                    stop(f"{entry} and {there} differ: the parts were made by other settings or versions")
    group = context.find_root().command
    code = group.main([command, *words, "--out", str(out)], standalone_mode=False)
    if code in (0, 1, None):
        shutil.rmtree(out / PARTS)
    raise typer.Exit(code or 0)


def _checked(out: Path) -> dict[JobPart, dict[str, Any]]:
    """Part → the arguments of its folder; exits with code 2 if the parts are not one whole."""
    made: list[tuple[JobPart, dict[str, Any]]] = []
    with refused(f"{out}: ", KeyError, TypeError):
        for file in sorted((out / PARTS).glob("*-of-*/.jgait-*.json")):
            manifest = json.loads(file.read_text(encoding="utf-8"))
            part = JobPart(*map(int, file.parent.name.split("-of-")))
            if not manifest["finished"]:
                stop(f"part {part} did not end; give its command again")
            made.append((part, manifest["arguments"]))
    if not made:
        stop(f"{out} has no parts; a command makes one by --part K/N with --out {out}")
    made.sort(key=lambda each: each[0])
    first, whole = made[0]
    others = [part for part, _ in made if part.of != first.of]
    twice = [part for part, many in Counter(part for part, _ in made).items() if many > 1]
    if others or twice:
        stop(f"{out / PARTS} holds part {first} and part {(others or twice)[0]}{'' if others else ' twice'}; "
             "remove the folders of one of them")  # fmt: skip
    for part, arguments in made:
        for name in sorted(whole.keys() | arguments.keys()):
            if arguments.get(name) != whole.get(name):
                stop(f"part {part} is of other arguments or inputs than part {first}: {name} was "
                     f"“{whole.get(name)}”, there “{arguments.get(name)}”")  # fmt: skip
    lacking = sorted({*range(1, first.of + 1)} - {part.number for part, _ in made})
    if lacking:
        numbers = ", ".join(map(str, lacking))
        stop(f"of {count(first.of, 'part', 'parts')} in {out / PARTS} these are missing: {numbers}")
    return dict(made)
