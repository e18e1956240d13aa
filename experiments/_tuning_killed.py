"""A fit that is killed at random moments, by force, and started again: the same result as one left alone?"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np
import optax
from _tuning_problems import FREE, START, drawn, nats
from common import Row, show

from jgait import tune

STEPS, PEOPLE = 300, 8


def fit(file: Path | None) -> list[np.ndarray]:
    """The fit that is killed; its numbers."""
    found = tune.fit(
        nats, START, FREE, drawn(jax.random.key(5), PEOPLE), optax.adam(0.05), steps=STEPS, starts=2, minibatch=4,
        key=jax.random.key(6), checkpoint_file=file, chunk=6,
    )  # fmt: skip
    return [np.asarray(leaf) for leaf in jax.tree.leaves(found)]


def killed(quick: bool) -> list[Row]:
    """Kill it at random moments until it was killed often enough, then let it end."""
    wanted, draw, kills, runs = 3 if quick else 20, np.random.default_rng(0), 0, []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        command = [sys.executable, __file__, str(folder / "fit.npz"), str(folder / "out.npz"), str(folder / "cache")]
        begin = time.perf_counter()
        subprocess.run([*command[:2], str(folder / "other.npz"), str(folder / "whole.npz"), command[4]], check=True)
        length = time.perf_counter() - begin
        while not (folder / "out.npz").exists():
            process = subprocess.Popen(command)
            try:
                # Now and then before it has begun, mostly while it runs; left alone when it was killed enough.
                process.wait(None if kills >= wanted else draw.uniform(0.3, 1.0) * length)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                kills += 1
            runs.append(process.returncode)
        with np.load(folder / "out.npz") as ours, np.load(folder / "whole.npz") as whole:
            same = all(
                np.array_equal(ours[key], whole[key], equal_nan=ours[key].dtype.kind == "f") for key in whole.files
            )
    show("killed and started again", ["kills", "runs", "the same bits"], [[kills, len(runs), str(same)]])
    return [Row("killed_resumed_equal", float(same), "bool", n=kills, split="SIGKILL at random moments of a fit")]


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_compilation_cache_dir", sys.argv[3])
    np.savez(sys.argv[2], *fit(Path(sys.argv[1])))
