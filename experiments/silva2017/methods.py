"""Stride lengths of every method on real recordings, with the lever learned on others; and learned pendulums."""

import numpy as np

from experiments.common.row import Row, show
from experiments.common.shanks import Leg
from experiments.silva2017.groups import length_line, measured_groups
from experiments.silva2017.lengths import (
    CUTOFF_HZ,
    Errors,
    Learned,
    Signals,
    errors,
    learn,
    lengths,
    part,
    with_lever,
)
from jgait.estimators.ankle_stride.length import StrideLengthParams

METHODS = ("SL1", "SL2", "SL2 of all axes", "Li 2-D", "Li 2-D, axes from the walk", "3-D as printed", "3-D")


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
                row = Row(f"{name}_li_mae_cm", best.mae_cm, "cm", n=best.each.size, split=_SPLITS[name])
                rows.append(row.on(length_line(name), "Li's planar method", "strides"))
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

    One speed does not determine the swing-time gain; the people of `walking5m` walk at many speeds, which determine it.
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


def rows(quick: bool) -> list[Row]:
    """Lengths, then pendulums."""
    found = measured_groups(quick)
    return stride_lengths(found) + pendulum(found)
