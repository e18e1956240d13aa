"""What `jgait estimate` does with a sensor at the waist: contacts, strides, distance, and how far to trust them."""

from pathlib import Path
from typing import Any

import numpy as np

from jgait.commands.console import note
from jgait.commands.estimate.legs import Show, table_of
from jgait.types import SIDES, Estimate, Recording, as_float

WORDS = {"turning": "turning", "unsure": "speed by integration unsure"}
"""Flag of a stride → what tables call it."""


def walks(params: Any, height: float | None, sensor_height: float | None, paper: bool, *, told: bool) -> Show:
    """How contacts and distance of a waist are estimated and shown.

    Args:
        params: to start from.
        height: of the person [m], or None.
        sensor_height: of the sensor above the ground [m], or None.
        paper: the paper's pipeline.
        told: whether the parameters are someone's own, so that no height is missing.
    """
    from jgait.estimators import waist as waist_ofdri

    given = {"height": height, "sensor_height": sensor_height}
    p = waist_ofdri.with_body(params, {name: value for name, value in given.items() if value is not None})
    if height is None and sensor_height is None and not told:
        note(
            f"neither --height nor --sensor-height: the sensor is taken to be {p.pendulum_length:g} m above the "
            "ground; a tenth of it more makes steps about 5 % longer"
        )
    options = waist_ofdri.PAPER if paper else waist_ofdri.DEFAULT

    latest: list[Recording] = []

    def run(recording: Recording) -> Estimate:
        latest[:] = [recording]
        return waist_ofdri.estimate(p, recording, options)

    def write(result: Estimate, out: Path, name: str) -> list[Path]:
        from jgait import plot

        files = _write(result, out, name)
        if np.size(result.diagnostics["initial_contact"]):
            # an estimate does not tell the accelerations over which contacts are drawn
            drawn = plot.trunk_contacts(latest[0], result, p=p, options=options, title=name)
            files.append(plot.save(drawn, out / f"{name}_contacts.png"))
        return files

    columns = (
        "recording",
        "contacts",
        "strides",
        "distance\n[m]",
        "±\n[m]",
        "length\n[m]",
        "speed\n[m/s]",
        "steps\n[1/min]",
    )
    caption = "distance with its standard deviation; length and speed: medians over strides; whole tables in the files"
    return Show(run, write, _rows, table_of("waist_ofdri", columns), caption, _numbers)


def contact_table(result: Estimate) -> Any:
    """The initial contacts: time [s] and side."""
    import pandas as pd

    sides = [SIDES[int(side)] for side in result.diagnostics["initial_contact_side"]]
    return pd.DataFrame({"time_s": as_float(result.diagnostics["initial_contact"]), "side": sides})


def stride_table(result: Estimate) -> Any:
    """The strides with a column `special`, in words."""
    from jgait import io

    table = io.strides_to_dataframe(result)
    order = np.argsort(as_float(result.strides.start), kind="stable")
    flags = {name: np.asarray(result.diagnostics[name], bool) for name in _told(result)}
    words = ["; ".join(WORDS[name] for name in flags if flags[name][k]) for k in order]
    return (table.dropna(axis="columns", how="all") if len(table) else table).assign(special=words)


def _told(result: Estimate) -> tuple[str, ...]:
    """The flags that matter: where the pendulum measures, integration may be unsure without harm."""
    return tuple(name for name in WORDS if name != "unsure" or "pendulum_constant" not in result.diagnostics)


def totals(result: Estimate) -> dict[str, Any]:
    """What the whole recording comes to."""
    strides, told = result.strides, result.diagnostics
    contacts = as_float(told["initial_contact"])
    apart = np.diff(contacts)
    walking = apart[apart < 1.5]
    return {
        "contacts": int(contacts.size),
        "strides": int(np.size(strides.side)),
        "distance_m": float(result.distance[-1]),
        "distance_std_m": float(told["distance_stddev"][-1]),
        "stride_length_m": _median(strides.length),
        "walking_speed_mps": _median(strides.speed),
        "cadence_spm": float(60.0 / np.median(walking)) if walking.size else None,
        **{name: int(np.sum(told[name])) for name in _told(result)},
    }


def _median(values: Any) -> float | None:
    found = as_float(values)
    found = found[np.isfinite(found)]
    return float(np.median(found)) if found.size else None


def _write(result: Estimate, out: Path, name: str) -> list[Path]:
    from jgait import io, plot

    files = [
        io.write_csv(contact_table(result), out / f"{name}_contacts.csv"),
        io.write_csv(stride_table(result), out / f"{name}_strides.csv"),
    ]
    if np.size(result.strides.side):
        files.append(plot.save(plot.leg_strides(result, title=name), out / f"{name}_strides.png"))
        files.append(plot.save(plot.distance(result, title=name), out / f"{name}_distance.png"))
    return files


def _rows(result: Estimate, name: str) -> list[list[str]]:
    told = totals(result)
    fields = ("distance_m", "distance_std_m", "stride_length_m", "walking_speed_mps")
    cells = ["–" if told[field] is None else f"{told[field]:.2f}" for field in fields]
    rhythm = "–" if told["cadence_spm"] is None else f"{told['cadence_spm']:.0f}"
    return [[name, str(told["contacts"]), str(told["strides"]), *cells, rhythm]]


def _numbers(result: Estimate) -> dict[str, Any]:
    """Totals, contacts and strides for the JSON file."""
    import json

    strides = json.loads(stride_table(result).to_json(orient="records", double_precision=6))
    contacts = json.loads(contact_table(result).to_json(orient="records", double_precision=6))
    return {"totals": totals(result), "contacts": contacts, "strides": strides}
