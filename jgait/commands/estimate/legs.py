"""What `jgait estimate` does with legs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.markup import escape
from rich.table import Table

from jgait.commands.console import note
from jgait.types import SIDES, Estimate, Recording


class Show(NamedTuple):
    """How recordings are estimated, and how what came of it is shown.

    Attributes:
        run: recording → estimate; raises ValueError for one that cannot be used.
        write: (estimate, folder, name) → files written.
        rows: (estimate, name) → rows of the table.
        table: of all recordings.
        caption: below it.
        numbers: estimate → what else the JSON file says of it; None: no more than of all.
    """

    run: Callable[[Recording], Estimate]
    write: Callable[[Estimate, Path, str], list[Path]]
    rows: Callable[[Estimate, str], list[list[str]]]
    table: Table
    caption: str
    numbers: Callable[[Estimate], dict[str, Any]] | None = None


def table_of(title: str, columns: tuple[str, ...]) -> Table:
    """An empty table whose first column is words and all others numbers."""
    table = Table(title=title, title_justify="left")
    for name in columns:
        table.add_column(escape(name), justify="left" if name == "recording" else "right")
    return table


def legs(
    params: Any, thigh: float | None, shank: float | None, scale: float | None, paper: bool, *, told: bool
) -> Show:
    """How legs are estimated and shown.

    Args:
        params: to start from.
        thigh: the person's own length [m], or None.
        shank: the same.
        scale: personal scale of the distance, or None.
        paper: the paper's pipeline.
        told: whether the parameters are someone's own, so that no length is missing.
    """
    from jgait.estimators import leg_ekf

    known = {"thigh_length": thigh, "shank_length": shank}
    usual = leg_ekf.LegParams()
    missing = [
        f"--{name.removesuffix('_length')}" for name, value in known.items()
        if value is None and tuple(map(float, getattr(params, name))) == getattr(usual, name)
    ]  # fmt: skip
    if missing:
        also = " (that of the parameters, too)" if told else ""
        note(
            f"no {' and '.join(missing)}: the default length of 0.43 m is taken{also}, and distances are in proportion "
            "to it"
        )
    p = leg_ekf.with_body(params, {name: value for name, value in known.items() if value is not None})
    p = p if scale is None else p._replace(distance_scale=scale)
    options = leg_ekf.PAPER if paper else leg_ekf.DEFAULT
    angles = tuple(f"{joint} {side} [°]" for side in SIDES for joint in ("hip", "knee"))
    return Show(
        lambda recording: leg_ekf.estimate(p, recording, options),
        _write,
        _rows,
        table_of(
            "leg_ekf, the paper's pipeline" if paper else "leg_ekf",
            ("recording", "duration [s]", "distance [m]", *angles),
        ),
        "angles: smallest … largest flexion",
    )


def _write(result: Estimate, out: Path, name: str) -> list[Path]:
    from jgait import io, plot

    return [
        io.write_csv(result, out / f"{name}_legs.csv"),
        plot.save(plot.joint_angles(result, title=name), out / f"{name}_angles.png"),
        plot.save(plot.foot_path(result, title=name), out / f"{name}_foot_path.png"),
        plot.save(plot.distance(result, title=name), out / f"{name}_distance.png"),
    ]


def _rows(result: Estimate, name: str) -> list[list[str]]:
    cells = [name, f"{result.time[-1] - result.time[0]:.1f}", f"{result.distance[-1]:.2f}"]
    for leg in result.legs:
        for values in (None, None) if leg is None else (leg.hip_angle, leg.knee_angle):
            if values is None:
                cells.append("–")
            else:
                low, high = np.degrees([np.min(values), np.max(values)])
                cells.append(f"{low:.0f} … {high:.0f}")
    return [cells]
