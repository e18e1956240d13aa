"""Legs of `tripod`, `neura_sparse` and `walking5m` in groups, and what learning and judging must not share."""

from functools import cache

import numpy as np

from experiments.common.recordings import available, names
from experiments.common.shanks import Leg, legs
from experiments.silva2017.lengths import (
    Signals,
    signals,
    stacked,
)

WHERE = {
    "tripod": "`tripod`",
    "neura_ankle": "`neura_sparse`, ankle",
    "neura_shank": "`neura_sparse`, mid shank",
    "walking5m": "`walking5m`",
}
"""Words of the table of all experiments."""


def length_line(name: str) -> str:
    """Line of the table of all experiments: stride length on a set."""
    return f"stride length, lever learned on others, {WHERE[name]}: MAE"


def turn_line(name: str) -> str:
    """Line of the table of all experiments: what turning the sensor changes."""
    return f"change of a stride as the sensor turns by 25° on the leg, {WHERE[name]}"


SETS = ("tripod", "neura_sparse", "walking5m")


@cache
def load(quick: bool) -> dict[str, list[Leg]]:
    """Group → its legs, of the sets that are here; the reason of a missing set is printed."""
    found: dict[str, list[Leg]] = {}
    for name in SETS:
        if not available(name):
            continue
        every = names(name)
        short = {"tripod": every[:1], "walking5m": [every[0], every[-1]]}.get(name, every)
        for leg in legs(name, short if quick else every):
            found.setdefault(leg.group, []).append(leg)
    return found


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


@cache
def measured_groups(quick: bool) -> dict[str, tuple[list[Leg], np.ndarray, Signals]]:
    """`measured` of what is here; the quick form takes one set, whose shapes are compiled for half a minute."""
    groups = load(quick)
    return measured({"neura_ankle": groups["neura_ankle"]} if quick and "neura_ankle" in groups else groups)
