"""Strides detected on real recordings by five detectors: whole strides, and half-steps included."""

from typing import Any

import numpy as np

from experiments.common.row import Row, show
from experiments.common.shanks import Leg
from experiments.silva2017.detect import DETECTORS, Score, f1, table
from experiments.silva2017.groups import load


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
        row = Row("f1_strict_pooled", f1(strict), "F1", n=count, split="half-steps included, all sets")
        rows.append(row.on("strides detected, half-steps included, all sets: F1", of="strides"))
    return rows


def _line(scores: list[Score]) -> list[Any]:
    late = np.concatenate([s.late for s in scores])
    within = np.concatenate([s.late - np.median(s.late) for s in scores if len(s.late)])
    apart = np.concatenate([s.stride_time for s in scores])
    hit, missed, extra = (sum(s[k] for s in scores) for k in range(3))
    times = [1000.0 * float(v) for v in (np.median(late), np.std(within), np.std(apart))]
    return [f"{f1(scores):.3f}", missed, extra, hit + missed, *(f"{v:.0f}" for v in times)]


def mistaken(groups: dict[str, list[Leg]]) -> list[Row]:
    """Sensors that are not at their stated placement, as the code noticed."""
    noticed = [[f"{leg.walk}, {leg.side}", str(note)] for of in groups.values() for leg in of for note in leg.notes]
    if noticed:
        show("Noticed", ["", ""], noticed)
    return [Row("sensors_noticed_exchanged", float(len(noticed)), "legs", n=sum(map(len, groups.values())))]


def rows(quick: bool) -> list[Row]:
    """What was noticed, and detection."""
    groups = load(quick)
    return mistaken(groups) + detection(groups) if groups else []
