"""Processor seconds of `jgait tune` on three simulated walks, over those of an earlier build.

Each command runs in fresh processes with an empty cache of compiled programs and then with the cache of that run, in
turn with the earlier build (see `today`). `…_over_today` are ratios with a filled cache, `…_cold_over_today` with an
empty one.
"""

import tempfile
from pathlib import Path

from experiments.benchmark import today
from experiments.benchmark.latency import cold_and_warm, spent
from experiments.common.process import ROOT
from experiments.common.row import Row, show

WALKS = ("simulate", "--people", 3, "--route", "straight:24")
LEARNED = {
    "readout": ("--free", "distance_scale"),
    "lengths": ("--free", "thigh_length,shank_length", "--loss", "trajectory"),
    "likelihood": ("--free", "gyro_noise,angle_noise", "--loss", "likelihood"),
    "reference": ("--free", "gyro_noise,angle_noise", "--loss", "trajectory"),
}
"""Task → the options of `jgait tune`."""


def rows(quick: bool) -> list[Row]:
    """All tasks; `quick` takes the first alone."""
    split = "three walks of 24 m, simulated; fresh processes, one run each"
    found, lines, noise = list[Row](), [], []
    with tempfile.TemporaryDirectory(prefix="jgait-tune-") as folder, today.earlier() as tree:
        scratch, trees = Path(folder), [ROOT] if tree is None else [ROOT, tree]
        spent(["-m", "jgait.cli", *WALKS, "--out", scratch / "walks"], scratch / "made")
        for task in list(LEARNED)[:1] if quick else LEARNED:
            command = ["tune", scratch / "walks" / "cohort.csv", *LEARNED[task]]
            (cold, warm), *before = cold_and_warm(command, scratch, 1, trees)
            lines.append([task, cold, warm, *(second for pair in before for second in pair)])
            if task == "readout":
                found.append(Row("readout_warm_s", warm, "s", None, 1, split))
            for earlier in before:
                ratio = warm / earlier[1]
                found.append(Row(f"{task}_over_today", ratio, "ratio", None, 1, split))
                found.append(Row(f"{task}_cold_over_today", cold / earlier[0], "ratio", None, 1, split))
                noise += [ratio] if task in ("likelihood", "reference") else []
    if noise:
        found.append(Row("noise_over_today", max(noise), "ratio", None, len(noise), split))
    earlier_columns = ["cold before", "warm before"] if lines and len(lines[0]) > 3 else []
    show("Processor seconds of tuning", ["", "cold", "warm", *earlier_columns], lines)
    return found
