"""Strides found and measured on real recordings: `tripod`, `neura_sparse` and `walking5m`, everything held out.

What is learned is the height of the sensor over the ankle (the lever), and where a row says so the filter's cut-off or
the gains of the pendulum; always on the other speed, the other leg, or other people.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from _ankle_detect import DETECTORS, Score, f1, table
from _ankle_filter import filtered
from _ankle_legs import Leg, legs
from _ankle_lengths import (
    CUTOFF_HZ,
    Errors,
    Learned,
    Signals,
    errors,
    learn,
    lengths,
    part,
    signals,
    stacked,
    with_lever,
)
from common import Row, show

from jgait import datasets
from jgait.estimators.ankle_stride.length import StrideLengthParams
from jgait.geometry.rotation import turn

SETS = ("tripod", "neura_sparse", "walking5m")
ANGLES = (5.0, 10.0, 15.0, 20.0, 25.0)
BIASES = (0.005, 0.01, 0.02)
METHODS = ("SL1", "SL2", "SL2 of all axes", "Li 2-D", "Li 2-D, axes from the walk", "3-D as printed", "3-D")


def load(quick: bool) -> dict[str, list[Leg]]:
    """Group → its legs, of the sets that are here; a missing one says so."""
    found: dict[str, list[Leg]] = {}
    for name in SETS:
        if not datasets.available(name):
            print(datasets.unavailable_reason(name))
            continue
        names = datasets.names(name)
        short = {"tripod": names[:1], "walking5m": (names[0], names[-1])}.get(name, names)
        for leg in legs(name, short if quick else names):
            found.setdefault(leg.group, []).append(leg)
    return found


def detection(groups: dict[str, list[Leg]]) -> list[Row]:
    """Strides found by five detectors: whole strides, and half-steps included."""
    rows, lines, strict = [], [], []
    sets = {"f1_neura_sparse": ("neura_ankle", "neura_shank"), "f1_walking5m_elderly": ("walking5m_elderly",)}
    sets |= {"f1_walking5m_young": ("walking5m_young",), "f1_tripod": ("tripod",)}
    for metric, members in sets.items():
        of = [leg for name in members for leg in groups.get(name, [])]
        if not of:
            continue
        full, half = (table(of, half_steps=flag) for flag in (False, True))
        strict += half["swings"]
        count = sum(s.hit + s.missed for s in full["swings"])
        lines += [[f"{metric[3:]}, {name}", *_line(full[name]), *_line(half[name])] for name in DETECTORS]
        rows += [
            Row(metric if name == "swings" else f"{metric}_{key}", f1(full[name]), "F1", n=count, split="whole strides")
            for name, key in zip(DETECTORS, ("", "machine", "paper", "jimenez", "feliz"), strict=True)
        ]
        rows.append(Row(f"{metric}_machine_strict", f1(half["machine"]), "F1", n=count, split="half-steps included"))
        if metric == "f1_tripod":
            spread = [1000.0 * float(np.std(s.stride_time)) for s in full["swings"]]
            rows.append(Row("tripod_f1_min", min(f1([s]) for s in full["swings"]), "F1", n=count, split="worst leg"))
            rows.append(Row("tripod_stride_time_sd_ms_max", max(spread), "ms", n=count, split="worst leg and speed"))
    columns = ["", "F1", "missed", "extra", "n", "late [ms]", "SD", "stride time SD"]
    show("Detection: whole strides, then half-steps included", [*columns, *columns[1:]], lines)
    if strict:
        count = sum(s.hit + s.missed for s in strict)
        rows.append(Row("f1_strict_pooled", f1(strict), "F1", n=count, split="half-steps included, all sets"))
    return rows


def _line(scores: list[Score]) -> list[Any]:
    late = np.concatenate([s.late for s in scores])
    within = np.concatenate([s.late - np.median(s.late) for s in scores if len(s.late)])
    apart = np.concatenate([s.stride_time for s in scores])
    hit, missed, extra = (sum(s[k] for s in scores) for k in range(3))
    times = [1000.0 * float(v) for v in (np.median(late), np.std(within), np.std(apart))]
    return [f"{f1(scores):.3f}", missed, extra, hit + missed, *(f"{v:.0f}" for v in times)]


def held_out(
    s: Signals, key: np.ndarray, method: str, *, cutoff: bool = False, judged: Signals | None = None,
    known: list[Learned] | None = None,
) -> tuple[np.ndarray, list[Learned]]:  # fmt: skip
    """Lengths (legs, n) of each leg with what was learned on the legs of another key.

    Args:
        s: legs, stacked.
        key: (legs,) what a leg must not share with those that are learned on.
        method: whose lengths.
        cutoff: learn the cut-off too.
        judged: the same legs, for example turned, to be measured instead.
        known: what a call before learned.
    """
    out, fits = np.zeros(np.shape(s.length)), []
    for number, one in enumerate(dict.fromkeys(key.tolist())):
        fit = learn(s, key != one, method, cutoff=cutoff) if known is None else known[number]
        told = lengths(method, with_lever(fit.height), fit.cutoff_hz, s if judged is None else judged)
        out[key == one] = np.asarray(told)[key == one]
        fits.append(fit)
    return out, fits


def keys(name: str, of: list[Leg]) -> np.ndarray:
    """What must not be shared: the walk (`tripod`: the speed), the leg (`neura_sparse`), the person (`walking5m`)."""
    return np.array([{"tripod": leg.walk, "neura": leg.side, "walking5m": leg.subject}[name] for leg in of])


def measured(groups: dict[str, list[Leg]]) -> dict[str, tuple[list[Leg], np.ndarray, Signals]]:
    """Set → legs, keys and signals; the groups of `walking5m` together, sites of `neura_sparse` apart."""
    sets = {"tripod": ("tripod",), "neura_ankle": ("neura_ankle",), "neura_shank": ("neura_shank",)}
    sets["walking5m"] = ("walking5m_elderly", "walking5m_young")
    out = {}
    for name, members in sets.items():
        of = [leg for member in members for leg in groups.get(member, [])]
        if of:
            out[name] = (of, keys(name.split("_")[0], of), stacked([signals(leg) for leg in of]))
    return out


def stride_lengths(found: dict[str, tuple[list[Leg], np.ndarray, Signals]]) -> list[Row]:
    """Every method on every set, without a lever and with a learned one."""
    rows, lines = [], []
    for name, (of, key, s) in found.items():
        if len(set(key.tolist())) < 2:
            continue
        for method in METHODS:
            plain = errors(lengths(method, with_lever(0.0), CUTOFF_HZ, s), s)
            line = [f"{name}, {method}", plain.mae_cm, plain.total_pct]
            if method.startswith("SL"):
                lines.append([*line, "–", "–", "–", "–"])
                continue
            told, fits = held_out(s, key, method, cutoff=name == "tripod")
            best, half = errors(told, s), errors(told, s, full=False)
            heights = f"{min(f.height for f in fits):.3f}–{max(f.height for f in fits):.3f}"
            lines.append([*line, best.mae_cm, best.total_pct, half.mae_cm, heights])
            if method == "3-D":
                rows += _length_rows(name, best, plain, len(of))
                rows += _by_group(name, of, told, s)
            elif method == "Li 2-D":
                rows.append(Row(f"{name}_li_no_lever_mae_cm", plain.mae_cm, "cm", n=plain.each.size))
                rows.append(Row(f"{name}_li_mae_cm", best.mae_cm, "cm", n=best.each.size, split=_SPLITS[name]))
    columns = ["", "MAE cm", "total %", "MAE cm, lever", "total %", "with half-steps", "lever [m]"]
    show("Stride lengths, whole strides: without a lever, and with one learned on others", columns, lines)
    return rows


_SPLITS = {
    "tripod": "lever and cut-off learned at the other speed",
    "neura_ankle": "lever learned on the other leg",
    "neura_shank": "lever learned on the other leg",
    "walking5m": "lever learned on the other people",
}


def _length_rows(name: str, best: Errors, plain: Errors, count: int) -> list[Row]:
    split = _SPLITS[name]
    worst = 100.0 * float(np.max(np.abs(best.total)))
    return [
        Row(f"{name}_3d_stride_mae_cm", best.mae_cm, "cm", n=best.each.size, split=split),
        Row(f"{name}_3d_distance_error_pct", best.total_pct, "%", n=count, split=split),
        Row(f"{name}_3d_distance_error_pct_max", worst, "%", n=count, split=split),
        Row(f"{name}_3d_no_lever_stride_mae_cm", plain.mae_cm, "cm", n=plain.each.size),
    ]


def _by_group(name: str, of: list[Leg], told: np.ndarray, s: Signals) -> list[Row]:
    groups = np.array([leg.group for leg in of])
    if len(set(groups.tolist())) < 2:
        return []
    rows = []
    for group in sorted(set(groups.tolist())):
        of_group = errors(told[groups == group], part(s, groups == group))
        rows.append(Row(f"{group}_3d_stride_mae_cm", of_group.mae_cm, "cm", n=of_group.each.size, split=_SPLITS[name]))
    return rows


def pendulum(found: dict[str, tuple[list[Leg], np.ndarray, Signals]]) -> list[Row]:
    """SL2 with learned gains, judged on others: one gain, two, and a swing-time gain learned on other people.

    One speed does not tell what another does; the people of `walking5m` walk at many, and tell the swing-time gain.
    """
    rows, lines, known = [], [], None
    for name, (of, key, s) in sorted(found.items(), key=lambda item: item[0] != "walking5m"):
        if len(set(key.tolist())) < 2:
            continue
        swing = np.asarray(lengths("swing", StrideLengthParams(), CUTOFF_HZ, s))
        tall = np.array([leg.leg_length or 0.85 for leg in of])[:, None]
        angle = tall * swing[..., 0]
        timed = angle / np.where(swing[..., 1] > 0.0, swing[..., 1], 1.0)
        both = np.stack([angle, timed], axis=-1)
        kinds = {"c": (both[..., :1], 0.0 * angle), "c, e": (both, 0.0 * angle)}
        if known is not None:
            kinds["c; e of other people"] = (both[..., :1], known * timed)
        for label, (design, offset) in kinds.items():
            told, gains = _taught(design, offset, s, key)
            off = errors(told, s)
            worst = 100.0 * float(np.max(np.abs(off.total)))
            lines.append([f"{name}: {label}", off.mae_cm, off.total_pct, worst, str(np.round(gains, 3))])
        if name == "walking5m":
            looked = np.asarray(s.full)
            known = float(np.linalg.lstsq(both[looked], np.asarray(s.length)[looked], rcond=None)[0][1])
        elif name == "tripod" and known is not None:
            split = f"c learned at the other speed, e = {known:.3f} on the people of walking5m"
            rows.append(Row("sl2_heldout_speed_error_pct", off.total_pct, "%", n=len(of), split=split))
            rows.append(Row("sl2_heldout_speed_error_pct_max", worst, "%", n=len(of), split=split))
    columns = ["L (c θ + e θ / T), learned:", "MAE cm", "total %", "worst %", "last gains"]
    show("Pendulum with learned gains, held out", columns, lines)
    return rows


def _taught(design: np.ndarray, offset: np.ndarray, s: Signals, key: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lengths offset + design · gains, the gains by least squares on the legs of other keys; and the last gains."""
    looked, length = np.asarray(s.full), np.asarray(s.length)
    told, gains = np.zeros_like(length), np.zeros(design.shape[-1])
    for one in dict.fromkeys(key.tolist()):
        taught = looked & (key != one)[:, None]
        gains = np.linalg.lstsq(design[taught], (length - offset)[taught], rcond=None)[0]
        told[key == one] = (offset + design @ gains)[key == one]
    return told, gains


def rotation_sweep(found: dict[str, tuple[list[Leg], np.ndarray, Signals]], quick: bool) -> list[Row]:
    """The sensor turned on the leg by an angle about a random axis, nobody knowing: what that does to a stride."""
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
        rows.append(Row(f"rotation25_{name}_li_change_cm", line[4], "cm", n=len(of), split="random axes"))
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


def mistaken(groups: dict[str, list[Leg]]) -> list[Row]:
    """Sensors that are not where they are said to be, as the code noticed."""
    noticed = [[f"{leg.walk}, {leg.side}", note] for of in groups.values() for leg in of for note in leg.notes]
    if noticed:
        show("Noticed", ["", ""], noticed)
    return [Row("sensors_noticed_exchanged", float(len(noticed)), "legs", n=sum(map(len, groups.values())))]


def real(quick: bool) -> list[Row]:
    """All that real recordings tell."""
    groups = load(quick)
    if not groups:
        return []
    rows = mistaken(groups) + detection(groups)
    # each set's shapes are compiled for half a minute: one is enough to show that it runs
    found = measured({"neura_ankle": groups["neura_ankle"]} if quick and "neura_ankle" in groups else groups)
    parts: list[Callable[[], list[Row]]] = [lambda: stride_lengths(found), lambda: pendulum(found)]
    parts.append(lambda: filtered(found, quick))
    if not quick:
        parts += [lambda: rotation_sweep(found, quick), lambda: bias_sweep(found)]
    for one in parts:
        rows += one()
    return rows
