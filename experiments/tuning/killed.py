"""A fit that is killed at random moments and started again gives the same bits as an undisturbed fit."""

import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np
import optax

from experiments.common.process import ROOT
from experiments.common.row import Row, show
from experiments.tuning.problems import FREE, START, drawn, nats
from jgait import tune

PEOPLE, CHUNK = 8, 6


def fit(file: Path | None, steps: int) -> list[np.ndarray]:
    """The fit that is killed; its numbers."""
    found = tune.fit(
        nats, START, FREE, drawn(jax.random.key(5), PEOPLE), optax.adam(0.05), steps=steps, starts=2, minibatch=4,
        key=jax.random.key(6), checkpoint_file=file, chunk=CHUNK, progress=lambda now: print(now.done, flush=True),
    )  # fmt: skip
    return [np.asarray(leaf) for leaf in jax.tree.leaves(found)]


def rows(quick: bool) -> list[Row]:
    """Kill it some random time after some random report of progress, often enough, and then let it end."""
    wanted, steps = (1, 120) if quick else (20, 900)
    draw, kills, runs = np.random.default_rng(0), 0, 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def started(file: str, out: str) -> subprocess.Popen[str]:
            command = [
                sys.executable,
                "-m",
                "experiments.tuning.killed",
                *(str(folder / part) for part in (file, out, "cache")),
                str(steps),
            ]
            return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)

        with started("other.npz", "whole.npz") as process:
            process.communicate()
        while not (folder / "out.npz").exists():
            with started("fit.npz", "out.npz") as process:
                reports = iter(process.stdout or ())
                if kills < wanted:
                    for _ in range(int(draw.integers(0, 8))):
                        next(reports, None)
                    time.sleep(draw.uniform(0.0, 0.1))
                    kills += process.poll() is None
                    process.kill()
                for _ in reports:
                    pass
            runs += 1
            if process.returncode not in (0, -signal.SIGKILL):
                raise RuntimeError(f"the fit ended with {process.returncode}")
        with np.load(folder / "out.npz") as ours, np.load(folder / "whole.npz") as whole:
            same = all(
                np.array_equal(ours[key], whole[key], equal_nan=ours[key].dtype.kind == "f") for key in whole.files
            )
    show("killed and started again", ["kills", "runs", "the same bits"], [[kills, runs, str(same)]])
    return [Row("killed_resumed_equal", float(same), "bool", n=kills, split="SIGKILL at random moments of a fit")]


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_compilation_cache_dir", sys.argv[3])
    np.savez(sys.argv[2], *fit(Path(sys.argv[1]), int(sys.argv[4])))
