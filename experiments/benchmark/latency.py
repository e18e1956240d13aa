"""How long a user waits: processor seconds of commands in fresh processes, with an empty and a filled cache.

Each command runs three times with an empty cache of compiled programs and three times with the cache of the last such
run; medians. `*_over_today_worst` are the largest ratios of these medians over those of an earlier build, see `today`,
whose commands run in turn with the present ones; those of `jgait estimate` without an estimator are
`seven_cold_over_today` and so on, by the number of sensors. Every further part is a fresh process of `latency_process`.
JGAIT_BENCHMARK_SUITE=1 runs the tests too.
"""

import compileall
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from experiments.benchmark import today
from experiments.common.process import ROOT, answers, started
from experiments.common.row import Row, show

MODULE = "experiments.benchmark.latency_process"
ESTIMATORS = ("leg_ekf", "foot_ins", "ankle_stride", "waist", "stride_width_ekf", "duty_cycled_gyro")
LENGTHS = tuple(round(12.0 + 1.9 * number, 1) for number in range(10))
"""[s] Ten lengths of files, 12 to 29 s."""
ROUTE = ("--route", "straight:17.5")
SPENT = ("imports", "reading", "preparing", "tracing", "xla", "cache", "running", "tables", "figures")


def spent(command: Sequence[Any], cache: Path, tree: Path = ROOT) -> float:
    """Processor seconds of a command, its threads and its own processes; compiled programs are kept in `cache`.

    Args:
        command: arguments of Python.
        cache: folder.
        tree: folder of the build.

    Raises:
        RuntimeError: if the command fails.
    """
    kept = {"XDG_CACHE_HOME": str(cache), "MPLCONFIGDIR": str(cache.parent / "matplotlib")}
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            [sys.executable, *map(str, command)], stdout=output, stderr=output, cwd=tree,
            env=today.variables(tree) | kept,
        )  # fmt: skip
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            output.seek(0)
            raise RuntimeError(f"{command} failed: {output.read().decode()[-3000:]}")
    return usage.ru_utime + usage.ru_stime


def cold_and_warm(
    command: Sequence[Any], scratch: Path, rounds: int, trees: Sequence[Path] = (ROOT,)
) -> list[tuple[float, float]]:
    """Medians of a `jgait` command, with an empty cache and with a filled one, for builds that run in turn.

    The cache of the first build stays in `scratch`/cache.
    """
    caches = [scratch / "cache", *(scratch / f"cache_{number}" for number in range(1, len(trees)))]
    out = scratch / "out"
    cold, warm = ([[] for _ in trees] for _ in range(2))
    for times in (cold, warm):
        for _ in range(rounds):
            for tree, cache, took in zip(trees, caches, times, strict=True):
                if times is cold:
                    shutil.rmtree(cache, ignore_errors=True)
                shutil.rmtree(out, ignore_errors=True)
                took.append(spent(["-m", "jgait.cli", *command, "--out", out], cache, tree))
    return list(zip(map(median, cold), map(median, warm), strict=True))


def rows(quick: bool) -> list[Row]:
    """All of it; `quick` takes one round, one estimator, and neither demonstration nor cohort."""
    with tempfile.TemporaryDirectory(prefix="jgait-latency-") as folder, today.earlier() as tree:
        return _rows(Path(folder), quick, [ROOT] if tree is None else [ROOT, tree])


def _rows(scratch: Path, quick: bool, trees: Sequence[Path]) -> list[Row]:
    """`trees` are this build, and the earlier one if it is there."""
    rounds = 1 if quick else 3
    split = f"processor seconds of fresh processes, medians of {rounds}"
    answers(started(MODULE, ["walks", scratch, *LENGTHS]))
    for tree in trees:
        compileall.compile_dir(tree / "jgait", quiet=1)
    spent(["-c", "import matplotlib.font_manager"], scratch / "cache")  # lists the fonts once
    spent(["-m", "jgait.cli", "--help"], scratch / "cache")
    helps = [spent(["-m", "jgait.cli", "--help"], scratch / "cache") for _ in range(rounds)]
    found = [Row("help_s", median(helps), "s", None, rounds, split)]
    lines = []
    for kind in ("seven",) if quick else ("seven", "three", "one"):
        command = ["estimate", scratch / f"{kind}.csv"]
        own, *before = cold_and_warm(command, scratch, rounds, trees)
        for number, state in enumerate(("cold", "warm")):
            if state == "cold":
                shutil.rmtree(scratch / "cache")
            lines.append(_line(f"{kind}, {state}", own[number], scratch, [*command, "--out", scratch / "parts"]))
            found.append(Row(f"analyse_{state}_s_{kind}", own[number], "s", None, rounds, split))
            found += [Row(f"{kind}_{state}_over_today", own[number] / earlier[number], "ratio", None, rounds, split)
                      for earlier in before]  # fmt: skip
    worst = dict.fromkeys(("next_length_compilations", "next_file_s", "warm_run_ms"), 0.0)
    over: dict[str, list[float]] = {"cold": [], "warm": []}
    for estimator in ESTIMATORS[:1] if quick else ESTIMATORS:
        kind = "range" if estimator == "stride_width_ekf" else "seven"
        one, ten = scratch / f"{kind}.csv", [scratch / f"{kind}_{length}.csv" for length in LENGTHS]
        (cold, warm), *before = cold_and_warm(["estimate", one, "--estimator", estimator], scratch, rounds, trees)
        for earlier in before:
            over["cold"].append(cold / earlier[0])
            over["warm"].append(warm / earlier[1])
            print(f"{estimator}: over the earlier build {over['cold'][-1]:.2f} cold, {over['warm'][-1]:.2f} warm")
        several = ["-m", "jgait.cli", "estimate", *ten, "--estimator", estimator, "--out", scratch / "ten"]
        following = (spent(several, scratch / "cache") - warm) / 9.0
        worst["next_file_s"] = max(worst["next_file_s"], following)
        (session,) = answers(started(MODULE, ["session", estimator, scratch / kind], scratch / "cache"))
        for name in ("next_length_compilations", "warm_run_ms"):
            worst[name] = max(worst[name], session[name])
        for state, seconds in (("cold", cold), ("warm", warm)):
            if state == "cold":
                shutil.rmtree(scratch / "cache")
            command = ["estimate", one, "--estimator", estimator, "--out", scratch / "parts" / state]
            lines.append(_line(f"{estimator}, {state}", seconds, scratch, command))
            found.append(Row(f"estimate_{state}_s_{estimator}", seconds, "s", None, rounds, split))
        shutil.rmtree(scratch / "parts")
        print(f"{estimator}: {session['next_length_compilations']:g} compilations of another length, "
              f"{session['warm_run_ms']:.1f} ms in a session, {following:.2f} s for each further file")  # fmt: skip
    for state, ratios in over.items():
        if ratios:
            found.append(Row(f"{state}_over_today_worst", max(ratios), "ratio", None, len(ratios), "in turn, medians"))
    ((cold, warm),) = cold_and_warm(["simulate", *ROUTE], scratch, rounds)
    for state, seconds in (("cold", cold), ("warm", warm)):
        found.append(Row(f"simulate_{state}_s", seconds, "s", None, rounds, split))
        lines.append([f"simulate, {state}", seconds, *("–" for _ in SPENT), "–"])
    units = {"next_length_compilations": "programs", "next_file_s": "s", "warm_run_ms": "ms"}
    found += [Row(name, value, units[name], None, 1, "worst estimator") for name, value in worst.items()]
    if not quick:
        ((cold, warm),) = cold_and_warm(["demo"], scratch, rounds)
        found += [
            Row("demo_cold_s", cold, "s", None, rounds, split),
            Row("demo_warm_s", warm, "s", None, rounds, split),
        ]
        lines += [["demo, cold", cold, *("–" for _ in SPENT), "–"], ["demo, warm", warm, *("–" for _ in SPENT), "–"]]
        seconds = [answers(started(MODULE, ["cohort", scratch / "seven", kind]))[0] for kind in ("many", "one")]
        ratio = seconds[0] / seconds[1]
        found.append(Row("lengths_over_one_length", ratio, "ratio", None, 100, "evaluate, with compiling"))
    if os.environ.get("JGAIT_BENCHMARK_SUITE"):
        found += suite(scratch)
    show("Processor seconds, and the parts of one run", ["", "all", *SPENT, "programs"], lines)
    return found


def _line(name: str, seconds: float, scratch: Path, command: Sequence[Any]) -> list[Any]:
    """The seconds of a command, those of its parts by a process that watches itself, and its number of programs."""
    (parts,) = answers(started(MODULE, ["parts", scratch / "cache" / "jgait" / "compiled", *command]))
    return [name, seconds, *(parts.get(part, 0.0) for part in SPENT), parts["programs"]]


def suite(scratch: Path) -> list[Row]:
    """Processor and clock minutes of all tests but `release`, with an empty and with a filled cache."""
    found = []
    for state in ("", "_warm"):
        begun = time.perf_counter()
        command = ["-m", "pytest", "-q", "-n", "2", "-m", "not release"]
        os.environ["JAX_COMPILATION_CACHE_DIR"] = str(scratch / "tests")
        seconds = spent(command, scratch / "cache")
        lasted = time.perf_counter() - begun
        found.append(Row(f"suite_cpu_min{state}", seconds / 60.0, "min", None, 1, "all tests but release"))
        found.append(Row(f"suite_wall_min{state}", lasted / 60.0, "min", None, 1, "two processes"))
    return found
