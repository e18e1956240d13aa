"""How long `import jgait` takes beside `import jax`: fresh processes in turn, medians.

The ratio is of the times less that of a Python that imports nothing.
"""

import subprocess
import sys
import time
from statistics import median

from experiments.common.row import Row, show

STATEMENTS = {
    "python": "pass",
    "jax": "import jax",
    "jgait": "import jgait",
    "leg_ekf": "from jgait.estimators import leg_ekf",
    "first_example": "import jax; from jgait import io, plot; from jgait.estimators import leg_ekf",
    "everything": "from jgait import datasets, estimators, evaluate, filtering, io, params, plot, simulate, tune",
}
"""Name → what a process imports; `first_example` is the README's."""

LIMIT = 1.5
"""Of what jax takes, at most, for `import jgait`."""


def seconds(statement: str) -> float:
    """Of one fresh process that imports the installed packages."""
    started = time.perf_counter()
    subprocess.run([sys.executable, "-P", "-c", statement], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - started


def rows(quick: bool) -> list[Row]:
    """Every statement once in each round, so that all share what else the machine does."""
    rounds = 3 if quick else 15
    for statement in STATEMENTS.values():
        seconds(statement)  # compiles what was not, and fills the disk's cache
    taken: dict[str, list[float]] = {name: [] for name in STATEMENTS}
    for _ in range(rounds):
        for name, statement in STATEMENTS.items():
            taken[name].append(seconds(statement))
    typical = {name: median(times) for name, times in taken.items()}
    start, jax = typical["python"], typical["jax"] - typical["python"]
    ratio = {name: (value - start) / jax for name, value in typical.items() if name != "python"}
    show(
        f"fresh processes, medians of {rounds} rounds",
        ["", "seconds", "of jax's, without Python's start"],
        [[name, value, ratio.get(name, "–")] for name, value in typical.items()],
    )
    print(f"import jgait takes {ratio['jgait']:.2f} of what jax takes; at most {LIMIT}")
    split = "fresh processes in turn, medians"
    return [
        *(Row(f"import_seconds_{name}", value, "s", None, rounds, split) for name, value in typical.items()),
        *(Row(f"import_ratio_{name}", value, "ratio", None, rounds, split) for name, value in ratio.items()),
    ]
