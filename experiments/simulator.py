"""The walking simulator: does it keep what it promises, how fast is it, and does it walk as people do.

Beside real recordings simulated people walk at the same stride, are sampled at the same rate and judged by the same
code; `inside` is 1 where the simulated median lies within the real 5 to 95 %. Speed and stride are given to the
simulator, and figures with a single real value have no spread: neither is counted. Of figures outside, the table says
which single parameter of the gait would bring them inside. --figures FOLDER says where pictures go.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import _simulated_gait as simulated
import _simulator_checks as checks
import jax
import jax.numpy as jnp
import numpy as np
from _filter_timing import peak_rss
from _real_gait import Spread, spread
from _simulated_gait import SETS, Set
from common import Row, main, show

from jgait import datasets, plot, simulate
from jgait.simulate import SEVEN, Person
from jgait.simulate.sensors import DEGREE, MPU6000

SCANNED: dict[str, tuple[float, float]] = {
    "stance_fraction": (0.56, 0.68), "step_width": (0.03, 0.18), "toe_out": (0.0, 20.0 * DEGREE),
    "toe_up": (10.0 * DEGREE, 45.0 * DEGREE), "heel_up": (55.0 * DEGREE, 95.0 * DEGREE), "foot_flat": (0.04, 0.14),
    "heel_off": (0.2, 0.45), "swing_lift": (0.0, 0.08), "landing_speed": (0.0, 0.8),
    "knee_stance": (2.0 * DEGREE, 18.0 * DEGREE), "pelvis_rise": (0.01, 0.09), "pelvis_sway": (0.0, 0.05),
    "pelvis_surge": (0.0, 0.05), "pelvis_rotation": (0.0, 10.0 * DEGREE), "pelvis_drop": (0.0, 9.0 * DEGREE),
    "pelvis_nod": (0.0, 5.0 * DEGREE), "pelvis_shock": (0.0, 0.01), "hip_ahead": (-0.05, 0.08),
}  # fmt: skip
"""What people plausibly do: where the scan looks."""

BATCH = 32


# --- real against simulated ---


def known_spread(given: Set) -> dict[str, Spread] | None:
    """What is usual in a set; None, with the reason printed, where it is absent."""
    if not datasets.available(given.name):
        print(datasets.unavailable_reason(given.name))
        return None
    return spread(given.name, given.condition)


def usual_person(real: dict[str, Spread], **others: float) -> Person:
    """A simulated person with the median stride of a set."""
    return simulated.person_at(real["stride_time"].median, real["stride_length"].median, **others)


def compared(given: Set, real: dict[str, Spread], figures: dict[str, float]) -> list[Row]:
    """Print a set beside its simulation; one row for each figure that can be compared."""
    rows, lines = [], []
    comparable = simulated.comparable(real)
    for name, one in real.items():
        if name not in figures:
            continue
        inside = one.low <= figures[name] <= one.high
        told = ("yes" if inside else "NO") if name in comparable else "given" if name in simulated.GIVEN else "–"
        lines.append([name, one.median, one.low, one.high, f"{one.n} {one.over}", figures[name], told])
        if name in comparable:
            rows.append(Row(f"inside_{given.label}_{name}", float(inside), "", None, one.n, f"over {one.over}"))
    columns = ["figure (SI, rad)", "real median", "5 %", "95 %", "n", "simulated median", "inside?"]
    show(f"{given.label}: real and simulated", columns, lines)
    return rows


def figures_of_people(people: list[Person], given: Set) -> list[dict[str, float]]:
    """Medians of everyone's figures, simulated in batches of one size; {} of who cannot walk like that."""
    found = []
    for start in range(0, len(people), BATCH):
        part = people[start : start + BATCH]
        filled = [*part, *[part[-1]] * (BATCH - len(part))]
        for one in simulated.walks_of(filled, given.rate_hz, given.acc_range)[: len(part)]:
            good = all(np.isfinite(values).all() for values in one.gyr.values())
            found.append(simulated.medians(simulated.simulated_figures(one, given)) if good else {})
    return found


def able(person: Person) -> bool:
    """Whether a person can walk as asked."""
    try:
        simulate.check_person(person)
    except ValueError:
        return False
    return True


def scan(given: Set, real: dict[str, Spread], values: int = 6) -> tuple[dict[str, float], list[list[Any]]]:
    """The usual person's figures, and for those outside: which single parameter would help, and how.

    Returns:
        Medians; lines of figure, by how much it is outside, parameter, its value now and the value nearest to it that
        brings the figure inside (or how far the best one comes), and how many of the set's figures are inside then.
    """
    moved = [(name, float(v)) for name, ends in SCANNED.items() for v in np.linspace(*ends, values)]
    people = [usual_person(real, **{name: value}) for name, value in moved]
    kept = [number for number, person in enumerate(people) if able(person)]
    base, *found = figures_of_people([usual_person(real), *(people[number] for number in kept)], given)
    comparable, lines = simulated.comparable(real), []
    usual = usual_person(real).gait
    inside = [sum(one.low <= f[key] <= one.high for key, one in comparable.items()) if f else 0 for f in found]
    for key, one in comparable.items():
        if one.low <= base[key] <= one.high:
            continue
        border = one.low if base[key] < one.low else one.high
        tries = []
        for name in SCANNED:
            mine = [(moved[n][1], f[key], count) for n, f, count in zip(kept, found, inside, strict=True)
                    if moved[n][0] == name and f]  # fmt: skip
            if mine:
                tries.append(_try(name, mine, one, float(getattr(usual, name)), base[key], border))
        useful = sorted((t for t in tries if t is not None), key=lambda t: t[0])[:3]
        lines += [[key, base[key] - border, *cells] for _, *cells in useful] or [[key, base[key] - border, *["–"] * 4]]
    return base, lines


def _try(name: str, mine: list[Any], one: Spread, now: float, base: float, border: float) -> list[Any] | None:
    """How well one parameter brings a figure inside: a rank (less is better) and cells; None where it hardly acts."""
    value, figure, count = (np.array(column) for column in zip(*mine, strict=True))
    if np.ptp(figure) < 0.3 * abs(border - base):
        return None
    fine = np.linspace(value[0], value[-1], 200)
    good = fine[(lambda f: (f >= one.low) & (f <= one.high))(np.interp(fine, value, figure))]
    if len(good):
        best = good[np.argmin(np.abs(good - now))]
        return [abs(best - now) / np.ptp(fine), name, now, float(best), int(count[np.argmin(np.abs(value - best))])]
    nearest = int(np.argmin(np.abs(figure - one.median)))
    return [2.0 + abs(figure[nearest] - one.median), name, now, f"{value[nearest]:.3g} gives {figure[nearest]:.3g}",
            int(count[nearest])]  # fmt: skip


def against_real(sets: tuple[Set, ...], folder: Path | None, values: int) -> list[Row]:
    """All rows of real against simulated, and the overlays."""
    rows: list[Row] = []
    for given in sets:
        real = known_spread(given)
        if real is None:
            continue
        base, lines = scan(given, real, values)
        rows += compared(given, real, base)
        columns = ["outside", "by", "parameter", "now", "would be inside at", "figures inside then"]
        show(f"{given.label}: which single parameter would help", columns, lines)
        if folder is not None:
            curves = simulated.real_curves(given)
            if curves:
                people = [usual_person(real)] * BATCH
                one = simulated.walks_of(people, given.rate_hz, given.acc_range)[0]
                drawn = simulated.overlay(given, curves, simulated.simulated_curves(one, given))
                print(plot.save(drawn, folder / f"overlay_{given.label}.png"))
    if rows:
        share = float(np.mean([row.value for row in rows]))
        rows.append(Row("figures_inside_share", share, "", None, len(rows), "all sets, what is given not counted"))
    return rows


# --- many people ---


def cohort(people: int, seconds: float, rate_hz: float, batch: int) -> None:
    """Simulate people in batches; print seconds to compile, seconds to run after a warm-up, and peak memory [GB]."""
    samples = round(seconds * rate_hz)
    moving = jnp.asarray(np.arange(samples) / rate_hz)
    drawn = simulate.population(jax.random.key(3), people)
    quiet = drawn.gait.quiet_before + drawn.gait.quiet_after
    steps = jnp.clip(jnp.floor((seconds - quiet) / (0.5 * drawn.gait.stride_time)) - 1.0, 1.0, CAPACITY)
    drawn = Person(drawn.body, drawn.gait._replace(steps=steps))
    keys = jax.random.split(jax.random.key(4), people)
    along = simulate.straight(100.0)

    def one(key: Any, person: Person, errors: Any) -> Any:
        read, truth = simulate.walk(key, person, along, moving, errors, capacity=CAPACITY, placements=SEVEN)
        return read, truth.estimate, truth.strides

    run = jax.jit(jax.vmap(one, in_axes=(0, 0, None)))
    parts = [
        jax.tree.map(lambda leaf, s=start: leaf[s : s + batch], (keys, drawn)) for start in range(0, people, batch)
    ]
    errors = jax.tree.map(float, MPU6000)
    start = time.perf_counter()
    compiled = run.lower(*parts[0], errors).compile()
    compiling = time.perf_counter() - start
    jax.block_until_ready(compiled(*parts[0], errors))
    start = time.perf_counter()
    for part in parts:
        jax.block_until_ready(compiled(*part, errors))
    print(compiling, time.perf_counter() - start, peak_rss())


CAPACITY = 144
"""Steps: room for a minute of the quickest."""


def cohort_rows(quick: bool) -> list[Row]:
    """The cohort in a process of its own, in float32 as JAX comes."""
    people, batch, suffix = (32, 16, "_quick") if quick else (1000, 20, "")
    command = [sys.executable, str(Path(__file__).resolve()), "--cohort", str(people), str(batch)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"the cohort failed: {done.stderr[-2000:]}")
    compiling, seconds, memory = (float(word) for word in done.stdout.split())
    split = f"{people} people × 60 s × 7 sensors, 100 Hz, float32, in batches of {batch}"
    name = f"cohort_{people}x60s_seconds{suffix}"
    return [
        Row(name, seconds, "s", None, people, split),
        Row(f"cohort_compile_seconds{suffix}", compiling, "s", None, 1, split),
        Row(f"cohort_peak_rss_gb{suffix}", memory, "GB", None, people, split),
    ]


# --- running ---


def pictures(folder: Path) -> None:
    """The default person as a moving stick figure, and one stride of all sensors."""
    read, truth = simulate.recording(jax.random.key(0))
    plot.stick_figure(truth, folder / "walk.gif")
    print(folder / "walk.gif")
    print(plot.save(plot.stride_signals(read, truth), folder / "stride.png"))


def experiment(quick: bool, folder: Path) -> list[Row]:
    """All of it; `quick` shows that it runs, on less."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = checks.walk_rows(20.0 if quick else 60.0)
    rows.append(checks.gradient_row(384))
    rows += checks.fit_rows(2, 60) if quick else checks.fit_rows(4, 300)
    rows += cohort_rows(quick)
    rows += against_real(SETS, folder, 2 if quick else 6)
    pictures(folder)
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--figures", type=Path, default=Path("results/simulator"))
    parser.add_argument("--cohort", nargs=2, type=int)
    own, sys.argv[1:] = parser.parse_known_args()
    if own.cohort:
        cohort(own.cohort[0], 60.0, 100.0, own.cohort[1])
    else:
        about = f"{__doc__.splitlines()[0]} --figures FOLDER: where pictures go"
        main("simulator", about, lambda quick: experiment(quick, own.figures))
