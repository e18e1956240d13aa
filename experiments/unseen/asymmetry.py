"""Asymmetry of steps and stances by shoes, beside contacts marked by hand in the same strides (`ipol_gait`).

Both are computed by the library's own summary: of the estimated strides, and of the marked strides that overlap them.
"""

from typing import NamedTuple

import numpy as np

from experiments.common.matching import overlapping
from experiments.common.recordings import attempt, available, walks
from experiments.common.row import Row, show
from jgait import analyse, io
from jgait.io.summary import summary
from jgait.types import Walk

UNITS = {"step_duration": "s", "stance": "%"}
SET = "ipol_gait"


class Asymmetry(NamedTuple):
    """Of one measure in one walk, (right − left) / mean [%], and how far the mean is off, in the measure's unit."""

    measure: str
    marked: float
    estimate: float
    stated: float
    off: float


def rows(quick: bool) -> list[Row]:
    """Of the walks that are here."""
    found: list[Asymmetry] = []
    for number, walk in enumerate(walks(SET) if available(SET) else ()):
        if walk.reference is not None and not (quick and number > 3):
            found += attempt(walk.recording.name, lambda walk=walk: of_walk(walk)) or []
    return of_walks(found)


def of_walk(walk: Walk) -> list[Asymmetry]:
    """The measures of one walk that both state."""
    assert walk.reference is not None
    feet = {name: imu for name, imu in walk.recording.sensors.items() if name.startswith("foot")}
    ours = io.analysis_to_dataframes(analyse(walk.recording._replace(sensors=feet)))["strides"]
    marked = io.strides_to_dataframe(walk.reference)
    marked["regular"], marked["source"] = False, "feet"
    for side in ("right", "left"):
        tables = [table[table["side"] == side] for table in (marked, ours)]
        pairs = overlapping(*(table[["start_s", "end_s"]].to_numpy() for table in tables))
        places = [table.index[pairs[:, i]] for i, table in enumerate(tables)]
        marked.loc[places[0], "regular"] = ours.loc[places[1], "regular"].to_numpy()
    marked["regular"] = marked["regular"].astype(bool)
    known, found = (summary(table).set_index("measure") for table in (marked, ours))
    both = [name for name in UNITS if name in known.index and name in found.index]
    made = [
        Asymmetry(
            name, *(float(table.loc[name, "asymmetry_pct"]) for table in (known, found)),
            float(found.loc[name, "asymmetry_std_pct"]), float(found.loc[name, "mean"] - known.loc[name, "mean"]),
        )
        for name in both
    ]  # fmt: skip
    return [one for one in made if np.isfinite([one.marked, one.estimate]).all()]


def of_walks(found: list[Asymmetry]) -> list[Row]:
    """Rows of the measures."""
    lines, made = [], []
    for name in UNITS:
        some = [one for one in found if one.measure == name]
        if not some:
            continue
        marked, ours, stated = (np.array([getattr(one, part) for one in some]) for part in Asymmetry._fields[1:-1])
        error = ours - marked
        inside = 100.0 * float(np.mean(np.abs(error) <= 2.0 * stated))
        typical, off = float(np.median(np.abs(error))), float(np.mean([one.off for one in some]))
        lines.append([name.replace("_", " "), len(some), np.median(np.abs(marked)), error.mean(), typical,
                      np.abs(error).max(), np.median(stated), inside, off])  # fmt: skip
        line = f"asymmetry of the {name.replace('_', ' ')}, shoes, `{SET}`: error in points"
        made.append(Row(f"{name}_bias", off, UNITS[name], n=len(some), split="defaults"))
        made.append(
            Row(f"asymmetry_{name}_points", typical, "%", n=len(some), split="defaults").on(line, "median", "walks")
        )
        made.append(Row(f"asymmetry_{name}_within_two_sigma_pct", inside, "%", n=len(some), split="defaults"))
    if lines:
        columns = [
            "",
            "walks",
            "marked, median size",
            "bias",
            "error, median",
            "largest",
            "stated",
            "within 2 SD [%]",
            "mean off [s, %]",
        ]
        show("Asymmetry by shoes beside contacts marked by hand [%]", columns, lines)
    return made
