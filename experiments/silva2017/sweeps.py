"""The sensor turned on the leg, and an added gyroscope bias: the changes of stride lengths without a filter."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from experiments.common.row import Row, show
from experiments.common.shanks import Leg
from experiments.silva2017.groups import measured_groups, turn_line
from experiments.silva2017.lengths import (
    Signals,
    errors,
    learn,
    lengths,
    signals,
    stacked,
    with_lever,
)
from experiments.silva2017.methods import held_out
from jgait.geometry.rotation import turn

ANGLES = (5.0, 10.0, 15.0, 20.0, 25.0)
BIASES = (0.005, 0.01, 0.02)


def rotation_sweep(found: dict[str, tuple[list[Leg], np.ndarray, Signals]], quick: bool) -> list[Row]:
    """Change of a stride's length when the sensor is turned about a random axis, unknown to the methods."""
    rows, lines = [], []
    for name, (of, key, s) in found.items():
        if len(set(key.tolist())) < 2:
            continue
        rng = np.random.default_rng(0)
        axes = rng.normal(size=(len(of), 3))
        before = {m: held_out(s, key, m) for m in ("3-D", "Li 2-D")}
        for angle in ANGLES[-1:] if quick else ANGLES:
            turned = stacked([
                signals(leg, np.asarray(turn(jnp.asarray(axis), np.deg2rad(angle))))
                for leg, axis in zip(of, axes, strict=True)
            ])  # fmt: skip
            line: list[Any] = [f"{name}, {angle:.0f}°"]
            for method in ("3-D", "Li 2-D"):
                after = held_out(s, key, method, judged=turned, known=before[method][1])[0]
                change = 100.0 * np.abs(after - before[method][0])[np.asarray(s.full)]
                wrong = errors(after, s).mae_cm
                line += [float(np.mean(change)), float(np.max(change)), wrong]
            lines.append(line)
        rows.append(Row(f"rotation25_{name}_3d_change_cm", line[1], "cm", n=len(of), split="random axes"))
        row = Row(f"rotation25_{name}_li_change_cm", line[4], "cm", n=len(of), split="random axes")
        rows.append(row.on(turn_line(name), "Li's planar method", "legs"))
        gain = 100.0 * (1.0 - line[3] / line[6])
        rows.append(Row(f"rotation25_{name}_gain_over_li_pct", gain, "%", 78.0 if name == "tripod" else None, len(of)))
    columns = ["", "3-D: change cm", "most", "MAE", "Li: change cm", "most", "MAE"]
    show("Sensor turned on the leg", columns, lines)
    changes = [row.value for row in rows if row.metric.endswith("_3d_change_cm")]
    if changes:
        rows.append(Row("rotation25_3d_change_cm", max(changes), "cm", n=len(changes), split="worst set, random axes"))
    return rows


def bias_sweep(found: dict[str, tuple[list[Leg], np.ndarray, Signals]]) -> list[Row]:
    """A gyroscope bias put in on every axis in turn: how far a leg's total moves without a filter."""
    rows, lines = [], []
    for name, (of, key, s) in found.items():
        if len(set(key.tolist())) < 2:
            continue
        fit = learn(s)
        plain = np.asarray(lengths("3-D", with_lever(fit.height), fit.cutoff_hz, s))
        looked = np.asarray(s.full)
        total = np.where(looked, plain, 0.0).sum(axis=1)
        line: list[Any] = [name]
        for bias in BIASES:
            moved = []
            for axis in range(3):
                off = np.zeros(3)
                off[axis] = bias
                told = lengths("3-D", with_lever(fit.height), fit.cutoff_hz, s._replace(gyr=s.gyr + off))
                moved.append(np.where(looked, np.asarray(told), 0.0).sum(axis=1) / total - 1.0)
            line.append(100.0 * float(np.mean(np.abs(moved))))
            line.append(100.0 * float(np.max(np.abs(moved))))
        lines.append(line)
        rows.append(Row(f"bias_002_{name}_unfiltered_change_pct", line[-2], "%", n=3 * len(of), split="each axis"))
    columns = ["", *(f"{b} rad/s: {what} %" for b in BIASES for what in ("mean", "most"))]
    show("Gyroscope bias put in, 3-D method without a filter: change of a leg's total", columns, lines)
    return rows


def rows(quick: bool) -> list[Row]:
    """Both; nothing in the quick form."""
    if quick:
        return []
    found = measured_groups(quick)
    return rotation_sweep(found, quick) + bias_sweep(found)
