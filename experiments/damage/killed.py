"""Commands that are killed at random moments and repeated, compared with commands that were left alone."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.common.process import environment
from experiments.common.row import Row, show

KILLS = 20
"""Killed runs of each command."""

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
"""What ends a run, in turn; after the last two, a command exits as shells do, and says so in one line."""

WALKS = ("--route", "straight:4", "--placements", "thigh_right,shank_right", "--rate", "50")


class Command(NamedTuple):
    """A command whose results are compared.

    Attributes:
        words: of the command, without `--out`.
        before: words of a command that writes to the same place first; () for none.
        out: place of the results, within a folder.
    """

    words: tuple[str, ...]
    before: tuple[str, ...] = ()
    out: str = "out"


COMMANDS = {
    "simulate": Command(
        ("simulate", *WALKS, "--people", "2", "--seed", "1", "--fresh"), ("simulate", *WALKS, "--people", "3")
    ),
    "evaluate": Command(("evaluate", "walks/cohort.csv", "--batch", "1")),
    "tune": Command(("tune", "walks/cohort.csv", "--free", "distance_scale", "--steps", "20")),
    "estimate": Command(("estimate", "walks/subject_0001.csv", "walks/subject_0002.csv")),
    "report": Command(("report", "walks/subject_0001.csv"), out="out/page.html"),
}


def started(words: Sequence[str], home: Path) -> "subprocess.Popen[bytes]":
    """A command in a process group of its own; compiled programs are shared by all."""
    variables = environment() | {"XDG_CACHE_HOME": str(home / "cache")}
    return subprocess.Popen(
        [sys.executable, "-m", "jgait.cli", *words], cwd=home, env=variables, start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def finished(words: Sequence[str], home: Path) -> float:
    """Run a command to its end; returns its duration [s].

    Raises:
        RuntimeError: if it fails.
    """
    begin = time.perf_counter()
    process = started(words, home)
    _, said = process.communicate()
    if process.returncode:
        raise RuntimeError(f"{' '.join(words)} ended with {process.returncode}: {said.decode()[-2000:]}")
    return time.perf_counter() - begin


def content(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, hidden ones too; the batches of an evaluation count together."""
    files = {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        name = path.relative_to(folder).as_posix()
        if name.startswith("run/part-"):  # after a kill, other recordings may be computed together
            name = f"run/{path.name}"
        files[name] = files.get(name, b"") + path.read_bytes()
    return files


def differences(command: Command, home: Path, kills: int, seed: int) -> list[str]:
    """Kill and repeat a command; what then differs from the command left alone.

    Args:
        command: the command.
        home: folder in which it runs; it holds `walks`.
        kills: number of runs that are killed, each in a folder of its own.
        seed: seed of the moments.
    """
    draw = np.random.default_rng(seed)

    def prepared(name: str) -> tuple[Path, list[str]]:
        out = home / name / Path(command.out).name if "/" in command.out else home / name
        if command.before:
            finished([*command.before, "--out", str(out)], home)
        return home / name, [*command.words, "--out", str(out)]

    whole, words = prepared("out")
    finished(words, home)  # compiles
    seconds = finished(words, home)
    expected = content(whole)
    template = home / "template"
    shutil.rmtree(whole)
    if command.before:
        prepared("out")
        whole.rename(template)
    found = []
    for number in range(kills):
        # The place is the same in all runs, for a page names the command that made it.
        shutil.rmtree(whole, ignore_errors=True)
        if command.before:
            shutil.copytree(template, whole)
        process = started(words, home)
        moment, kill = draw.uniform(0.2, 1.0) * seconds, SIGNALS[number % len(SIGNALS)]
        try:
            process.wait(moment)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, kill)
        said = process.communicate()[1].decode()
        if process.returncode not in (0, -kill, 128 + kill) or "Traceback" in said:
            found.append(f"run {number}, {kill.name} after {moment:.2f} s: ended with {process.returncode}: {said}")
        finished(words, home)
        now = content(whole)
        for name in sorted(now.keys() | expected.keys()):
            if now.get(name) != expected.get(name):
                found.append(f"run {number}, killed after {moment:.2f} of {seconds:.2f} s: {name}")
    shutil.rmtree(whole)
    shutil.rmtree(template, ignore_errors=True)
    return found


def walks(home: Path) -> None:
    """The recordings that commands read."""
    finished(["simulate", *WALKS, "--people", "2", "--out", "walks"], home)


def rows(quick: bool) -> list[Row]:
    """Kill every command."""
    kills = 1 if quick else KILLS
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        walks(home)
        found = {command: differences(COMMANDS[command], home, kills, seed) for seed, command in enumerate(COMMANDS)}
    show("killed and repeated", ["command", "runs", "different files"], [[c, kills, len(d)] for c, d in found.items()])
    print("\n".join(f"{command}: {line}" for command, lines in found.items() for line in lines))
    total = sum(len({line.split(",")[0] for line in lines}) for lines in found.values())
    row = Row(
        "kill_differences", total, "runs", n=kills * len(COMMANDS), split="SIGKILL, SIGTERM, SIGINT at random moments"
    )
    return [row.on("commands killed and given again: different results", of="kills", simulated=True)]
