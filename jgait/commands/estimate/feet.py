"""What `jgait estimate` does with feet: their ways, strides, and widths where a range was heard."""

from pathlib import Path
from typing import Any

import numpy as np

from jgait.commands.console import note, stop
from jgait.commands.estimate.legs import Show, table_of
from jgait.types import Estimate, Recording, as_float

LEVEL: dict[str, bool | str] = {"auto": "auto", "yes": True, "no": False}


def feet(
    estimator: str, params: Any, pivot: float | None, level: str | None, range_offset: float | None, paper: bool, *,
    told: bool,
) -> Show:  # fmt: skip
    """How feet are estimated and shown.

    Args:
        estimator: "foot_ins" or "stride_width_ekf".
        params: of it, to start from.
        pivot: height of the sensor over the point that a standing foot turns about [m], or None.
        level: "auto", "yes", "no", or None.
        range_offset: how much farther apart the feet are than the range says [m], or None.
        paper: the paper's pipeline, of widths.
        told: whether the parameters are someone's own, so that no offset is missing.
    """
    from jgait.estimators import foot_ins, stride_width_ekf

    if level not in (None, *LEVEL):
        stop(f"--level is {', '.join(LEVEL)}; got {level!r}")
    options = foot_ins.DEFAULT if level is None else foot_ins.DEFAULT._replace(level=LEVEL[level])
    body = {} if pivot is None else {"pivot_height": pivot}
    columns = ("recording", "duration [s]", "distance [m]", "strides", "stride length [m]", "speed [m/s]")
    caption = "medians over the strides"
    if estimator == "foot_ins":
        own = foot_ins.with_body(params, body)

        def run(recording: Recording) -> Estimate:
            return foot_ins.estimate(own, recording, options)

        return Show(run, _write, _rows, table_of("foot_ins", columns), caption)
    if range_offset is None and not told:
        note(f"no --range-offset: the default of {params.range_offset:g} m is taken, and widths are off by its error")
    widths = params if range_offset is None else stride_width_ekf.with_body(params, {"range_offset": range_offset})
    feet_params = foot_ins.with_body(foot_ins.FootParams(), body)
    pipeline = stride_width_ekf.PAPER if paper else stride_width_ekf.DEFAULT

    def together(recording: Recording) -> Estimate:
        return stride_width_ekf.estimate(
            widths, recording, pipeline, foot_params=feet_params, foot_options=options
        )  # fmt: skip

    return Show(
        together,
        _write_widths,
        lambda result, name: [[*row, _trusted(result)] for row in _rows(result, name)],
        table_of(
            "stride_width_ekf, the paper's pipeline" if paper else "stride_width_ekf",
            (*columns, "stride width [cm]"),
        ),
        f"{caption}; widths over those that can be trusted, which are in brackets",
    )


def _write(result: Estimate, out: Path, name: str) -> list[Path]:
    from jgait import io, plot

    files = [
        io.write_csv(result, out / f"{name}_feet.csv"),
        io.write_csv(io.strides_to_dataframe(result), out / f"{name}_strides.csv"),
        plot.save(plot.foot_paths(result, title=name), out / f"{name}_paths.png"),
        plot.save(plot.foot_height(result, title=name), out / f"{name}_height.png"),
    ]
    if np.any(result.strides.valid):
        files.append(plot.save(plot.stride_series(result, title=name), out / f"{name}_strides.png"))
    return files


def _write_widths(result: Estimate, out: Path, name: str) -> list[Path]:
    from jgait import plot

    files = _write(result, out, name)
    if np.isfinite(as_float(result.strides.width)).any():
        files.append(plot.save(plot.two_feet(result, title=name), out / f"{name}_widths.png"))
    return files


def _rows(result: Estimate, name: str) -> list[list[str]]:
    rows = np.flatnonzero(np.asarray(result.strides.valid, bool))
    told = (_median(getattr(result.strides, field), rows, 2) for field in ("length", "speed"))
    way = "–" if result.distance is None else f"{result.distance[-1]:.2f}"
    return [[name, f"{result.time[-1] - result.time[0]:.1f}", way, str(rows.size), *told]]


def _trusted(result: Estimate) -> str:
    """Median width [cm] of the strides whose width can be trusted, and how many they are."""
    width = 100.0 * as_float(result.strides.width)
    good = np.isfinite(width) & np.asarray(result.strides.valid, bool)
    good &= np.asarray(result.diagnostics.get("width_valid", good), bool)
    return f"{_median(width, np.flatnonzero(good), 1)} ({int(good.sum())})"


def _median(values: Any, rows: np.ndarray, digits: int) -> str:
    found = np.zeros(0) if values is None else as_float(values)[rows]
    found = found[np.isfinite(found)]
    return f"{np.median(found):.{digits}f}" if found.size else "–"
