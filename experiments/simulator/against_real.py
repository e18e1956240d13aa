"""The figures of simulated gait beside those of real recordings.

Beside real recordings simulated people walk at the same stride, are sampled at the same rate and judged by the same
code; `inside` is 1 where the simulated median lies within the real 5 to 95 %. Speed and stride are given to the
simulator, and figures with a single real value have no spread: neither is counted. For figures outside, the table
lists the single parameters of the gait that would bring them inside.
"""

from pathlib import Path
from typing import Any

import jax
import numpy as np

from experiments.common.people import check_person
from experiments.common.recordings import available
from experiments.common.row import Row, show
from experiments.simulator import simulated
from experiments.simulator.real import Spread, spread
from experiments.simulator.simulated import SETS, Set
from jgait import plot, simulate
from jgait.simulate import Gait, Person
from jgait.simulate.sensors import DEGREE

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


def known_spread(given: Set) -> dict[str, Spread] | None:
    """What is usual in a set; None, with the reason printed, where it is absent."""
    return spread(given.name, given.condition) if available(given.name) else None


def usual_person(real: dict[str, Spread], base: Gait = simulated.RULES, **others: float) -> Person:
    """A simulated person with the median stride of a set."""
    return simulated.person_at(real["stride_time"].median, real["stride_length"].median, base, **others)


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
    """Medians of everyone's figures, simulated in batches of one size; {} for a person who cannot walk like that."""
    found = []
    for start in range(0, len(people), BATCH):
        part = people[start : start + BATCH]
        filled = [*part, *[part[-1]] * (BATCH - len(part))]
        for one in simulated.walks_of(filled, given)[: len(part)]:
            good = all(np.isfinite(values).all() for values in one.gyr.values())
            found.append(simulated.medians(simulated.simulated_figures(one, given)) if good else {})
    return found


def able(person: Person) -> bool:
    """Whether a person can walk with these parameters."""
    try:
        check_person(person)
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


def rows(quick: bool) -> list[Row]:
    """Of every set that is here."""
    found: list[Row] = []
    for given in SETS:
        real = known_spread(given)
        if real is None:
            continue
        base, lines = scan(given, real, 2 if quick else 6)
        found += compared(given, real, base)
        columns = ["outside", "by", "parameter", "now", "would be inside at", "figures inside then"]
        show(f"{given.label}: which single parameter would help", columns, lines)
    if found:
        share = float(np.mean([row.value for row in found]))
        row = Row("figures_inside_share", share, "", None, len(found), "all sets, what is given not counted")
        found.append(row.on("figures of simulated gait within 5 to 95 % of real ones, all sets: share", of="figures"))
    return found


def draw(_: list[Row], folder: Path, quick: bool) -> None:
    """Real and simulated strides over each other; the default person as a stick figure, and one stride's signals."""
    folder.mkdir(parents=True, exist_ok=True)
    for given in SETS[:1] if quick else SETS:
        real = known_spread(given)
        curves = None if real is None else simulated.real_curves(given)
        if curves:
            one = simulated.walks_of([usual_person(real)] * BATCH, given)[0]
            drawn = simulated.overlay(given, curves, simulated.simulated_curves(one, given))
            print(plot.save(drawn, folder / f"overlay_{given.label}.png"))
    read, truth = simulate.recording(jax.random.key(0))
    plot.stick_figure(truth, folder / "walk.gif")
    print(folder / "walk.gif")
    print(plot.save(plot.stride_signals(read, truth), folder / "stride.png"))
