"""The cost of simulated people who walk as recorded ones: errors of the signals, time of a cohort, time to compile."""

import json
import time

from experiments.common.process import answers, started
from experiments.common.row import Row
from experiments.simulator import checks, cohort
from jgait import simulate
from jgait.simulate import RECORDED, Person

SHORT = "60 s, 7 sensors, 100 Hz, float32"
PROCESSES = 3
"""Processes of which the quickest counts: others on the same cores slow a compiler down, never speed it up."""


def compiled() -> None:
    """Print the CPU seconds that the first walk takes longer than the second."""
    import jax

    jax.config.update("jax_enable_x64", True)
    seconds = []
    for number in range(2):
        start = time.process_time()
        simulate.recording(jax.random.key(number), Person(gait=RECORDED._replace(soft_tissue=1.0)))
        seconds.append(time.process_time() - start)
    print(json.dumps(seconds[0] - seconds[1]))


def rows(quick: bool) -> list[Row]:
    """Of all three; people in processes of their own."""
    seconds = 20.0 if quick else 60.0
    person, read, truth = checks.long_walk(seconds, RECORDED)
    apart = checks.strapdown_rows(read, truth, person)[0].value
    split = (
        f"{seconds:g} s round a rectangle, worst of {len(read.sensors)} ideal sensors, {checks.RATE_HZ:g} Hz, float64"
    )
    people, batch = (32, 16) if quick else (1000, 10)
    *_, busy = cohort.measured(people, batch, recorded=True)
    times = [answers(started("experiments.people.cost", []))[0] for _ in range(1 if quick else PROCESSES)]
    about = "people who walk as recorded ones"
    return [
        Row("strapdown_mm", apart, "mm", None, len(read.sensors), split).on(
            f"{about}: a perfect sensor integrated for a minute, error of the position", "", "sensors", simulated=True
        ),
        Row(
            "cohort_s", 0.5 * busy, "s", None, people, f"{SHORT}, in batches of {batch}; processor seconds over two"
        ).on(f"{about}: time of a minute with seven sensors, two idle cores", "", "people", simulated=True),
        Row("compile_s", min(times), "s", None, len(times), "CPU seconds, float64, the least of the processes").on(
            f"{about}: CPU time to compile one walk", "", "processes", simulated=True
        ),
    ]


if __name__ == "__main__":
    compiled()
