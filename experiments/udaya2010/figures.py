"""The paper's Figure 7 with every filler, and error against energy saved with the paper's points on it."""

from pathlib import Path

from experiments.common.row import Row
from experiments.udaya2010.curves import Series, error_over_duty, error_over_saving
from experiments.udaya2010.fillers import fillers
from experiments.udaya2010.table2 import ERRORS, SAVINGS
from experiments.udaya2010.tradeoff import tradeoff
from jgait import plot
from jgait.duty_cycle import power

PANELS = {
    "tripod": "tripod, treadmill, paper's protocol (14 s, units of 1.4 s)",
    "walking5m": "walking5m, five metres over ground, two strides first, with the thigh's sensor",
    "neura_sparse": "neura_sparse, walk with a U-turn, two strides first, with the thigh's sensor",
    "simulation": "simulated people, paper's protocol",
}


def _lines(protocol: str, told: dict[str, float], *, saving: bool) -> dict[str, Series]:
    """The paper's curve and every filler's, over duty or over what is saved."""
    duties = list(SAVINGS)
    paper = [(SAVINGS[d] if saving else d) / 100.0 for d in duties]
    lines = {"paper (Table 2)": Series(paper, [ERRORS[d] for d in duties], "paper")}
    for name in fillers():
        own = [d for d in duties if f"{protocol}_{name}_duty{d}" in told]
        if own:
            x = [d / 100.0 for d in own]
            if saving:
                x = [told.get(f"{protocol}_energy_saving_duty{d}", SAVINGS[d]) / 100.0 for d in own]
            lines[name] = Series(x, [told[f"{protocol}_{name}_duty{d}"] for d in own])
    return lines


def rows(quick: bool) -> list[Row]:
    """None: this part draws."""
    return []


def draw(rows: list[Row], folder: Path, quick: bool) -> None:
    """Write both figures."""
    fronts = tradeoff(quick)[1]
    folder.mkdir(parents=True, exist_ok=True)
    told = {row.metric: row.value for row in rows}
    seen = {name: title for name, title in PANELS.items() if any(m.startswith(f"{name}_neighbours") for m in told)}
    over_duty = {title: _lines(name, told, saving=False) for name, title in seen.items()}
    drawn = {"duty_error": error_over_duty(over_duty, title="What sleep costs, by filler: median over legs")}
    over_saving = {}
    for name in (n for n in ("tripod", "walking5m") if n in seen):
        lines = _lines(name, told, saving=True)
        if name in fronts:
            points, fixed = fronts[name]
            lines["fixed schedules\n(two strides first, unseen legs)"] = Series(*zip(*fixed, strict=True))
            lines["found by gradient\n(two strides first, unseen legs)"] = Series(
                [p.saving for p in points], [p.error for p in points], "found"
            )
        prefix, level = ("triggered_tripod", 0.05) if name == "tripod" else ("triggered", 0.10)
        energy = told.get(f"{prefix}_energy_policy_pct")
        if energy is not None:
            lines["woken by doubt\n(two strides first, unseen legs)"] = Series(
                [1.0 - energy / 100.0], [level], "policy"
            )
        over_saving[seen[name]] = lines
    drawn["duty_pareto"] = error_over_saving(over_saving, power=power.GYROSCOPE.on, title="Error against energy saved")
    for name, figure in drawn.items():
        print(plot.save(figure, folder / f"{name}.png"))
