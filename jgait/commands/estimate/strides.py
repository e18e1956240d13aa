"""What `jgait estimate` does with a sensor at an ankle or on a shank: strides of its leg, totals, flags in words."""

from pathlib import Path
from typing import Any

import numpy as np

from jgait.commands.console import note, stop
from jgait.commands.estimate.legs import Show, table_of
from jgait.types import SIDES, Estimate, Recording, as_float

WORDS = {
    "turning": "turning",
    "stairs": "stairs",
    "clipped": "clipped",
    "half": "half-step",
}
"""Flag of a stride → what tables call it."""

TAPE_SD = 0.01
"""[m] How far a height over the ankle that somebody measured is trusted."""

AXES = {"x": 0, "y": 1, "z": 2}


def strides(params: Any, lever: float | None, axes: str | None, *, told: bool) -> Show:
    """How strides of a leg are estimated and shown.

    Args:
        params: to start from.
        lever: height of the sensor over the ankle [m], or None.
        axes: which of the sensor's axes look forward, left and up, as the wearer was told ("x,y,z"), or None.
        told: whether the parameters are someone's own, so that no height is missing.
    """
    from jgait.estimators import ankle_stride

    believed = None if axes is None else believed_axes(axes)
    p = params
    if lever is not None:
        p = ankle_stride.with_body(params, {"lever_ankle": lever, "lever_shank": lever})
        p = p._replace(lever_along_sd=min(TAPE_SD, float(p.lever_along_sd)))
    elif not told:
        note(
            f"no --lever: a sensor at the ankle is taken to sit {p.lever_ankle:g} m above it, one on the shank "
            f"{p.lever_shank:g} m; the walk corrects that a little, and 0.1 m make a stride 3 to 7 cm wrong"
        )

    def run(recording: Recording) -> Estimate:
        result = ankle_stride.estimate(p, recording)
        said = () if believed is None else worn_otherwise(recording, believed)
        return result._replace(diagnostics={**result.diagnostics, "notes": (*result.diagnostics["notes"], *said)})

    columns = ("recording", "leg", "strides", "distance\n[m]", "length\n[m]", "speed\n[m/s]", "special")
    caption = "length and speed: medians over whole strides; whole tables in the files"
    table = table_of("ankle_stride", columns)
    table.columns[-1].justify = "left"
    return Show(run, _write, _rows, table, caption, _numbers)


def believed_axes(text: str) -> np.ndarray:
    """(3, 3) forward, left and up in a sensor's axes, of words such as "x,-z,y"; leaves with 2 where they are none."""
    rows = []
    for word in text.split(","):
        name = word.strip().lower().removeprefix("+")
        at = AXES.get(name.removeprefix("-"))
        if at is None:
            break
        rows.append(np.eye(3)[at] * (-1.0 if name.startswith("-") else 1.0))
    if len(rows) != 3 or np.linalg.det(np.stack(rows)) < 0.5:
        stop(
            f"--axes names the axes that look forward, left and up, right-handed, such as x,y,z or -z,y,x; got {text!r}"
        )
    return np.stack(rows)


def worn_otherwise(recording: Recording, believed: np.ndarray) -> tuple[str, ...]:
    """In words, which sensors are not worn as they are believed to be: upside down, or on the other leg."""
    from jgait.estimators.ankle_stride.prepare import placement_of
    from jgait.mounting import shank as shank_axes

    said = []
    for side in SIDES:
        name = placement_of(recording, side)
        found = None if name is None else shank_axes.functional_axes(recording.sensors[name])
        wrong = None if found is None else shank_axes.mounting(found, believed)
        if wrong is not None:
            said.append(f"{name}: {wrong}; strides are told all the same")
    return tuple(said)


def flags_of(result: Estimate) -> list[list[str]]:
    """What is special about each stride, in words, in the order of `diagnostics`."""
    flags = {name: np.asarray(result.diagnostics[name], bool) for name in WORDS}
    return [[WORDS[name] for name in WORDS if flags[name][k]] for k in range(np.size(result.strides.side))]


def stride_table(result: Estimate) -> Any:
    """The strides with a column `special`, in words; a stride with none has an empty one."""
    from jgait import io

    table = io.strides_to_dataframe(result)
    order = np.argsort(as_float(result.strides.start), kind="stable")
    words = flags_of(result)
    told = table.dropna(axis="columns", how="all") if len(table) else table
    return told.assign(special=["; ".join(words[k]) for k in order])


def totals(result: Estimate) -> list[dict[str, Any]]:
    """A row for each leg that was worn: what all of its strides come to; medians are over whole strides."""
    strides, rows = result.strides, []
    side, half = np.asarray(strides.side), np.asarray(result.diagnostics["half"], bool)
    duration = as_float(strides.end) - as_float(strides.start)
    for number, name in enumerate(SIDES):
        if f"instants_{name}" not in result.diagnostics:
            continue
        own = side == number
        whole = own & ~half if np.any(own & ~half) else own
        lever = result.diagnostics[f"lever_{name}"]
        rows.append({
            "side": name,
            "strides": int(own.sum()),
            "distance_m": float(as_float(strides.length)[own].sum()),
            "stride_length_m": _median(strides.length, whole),
            "stride_duration_s": _median(duration, whole),
            "walking_speed_mps": _median(strides.speed, whole),
            **{flag: int(np.sum(np.asarray(result.diagnostics[flag], bool) & own)) for flag in WORDS},
            "lever_m": float(lever[2]),
            "lever_std_m": float(result.diagnostics[f"lever_stddev_{name}"][2]),
        })  # fmt: skip
    return rows


def _median(values: Any, rows: np.ndarray) -> float | None:
    found = as_float(values)[rows]
    found = found[np.isfinite(found)]
    return float(np.median(found)) if found.size else None


def _write(result: Estimate, out: Path, name: str) -> list[Path]:
    import pandas as pd

    from jgait import io, plot

    files = [
        io.write_csv(stride_table(result), out / f"{name}_strides.csv"),
        io.write_csv(pd.DataFrame(totals(result)), out / f"{name}_totals.csv"),
    ]
    if np.size(result.strides.side):
        files.append(plot.save(plot.leg_strides(result, title=name), out / f"{name}_strides.png"))
        files.append(plot.save(plot.distance(result, title=name), out / f"{name}_distance.png"))
    return files


def _rows(result: Estimate, name: str) -> list[list[str]]:
    """A row for each leg."""
    fields = ("distance_m", "stride_length_m", "walking_speed_mps")
    rows = []
    for leg in totals(result):
        cells = ("–" if leg[field] is None else f"{leg[field]:.2f}" for field in fields)
        special = ", ".join(f"{leg[flag]} {word}" for flag, word in WORDS.items() if leg[flag])
        rows.append([name, leg["side"], str(leg["strides"]), *cells, special or "–"])
    return rows


def _numbers(result: Estimate) -> dict[str, Any]:
    """Totals and strides for the JSON file."""
    import json

    table = stride_table(result)
    rows = json.loads(table.assign(special=[text.split("; ") if text else [] for text in table["special"]])
                      .to_json(orient="records", double_precision=6))  # fmt: skip
    return {"legs": totals(result), "strides": rows}
