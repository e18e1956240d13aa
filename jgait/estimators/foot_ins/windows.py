"""Long recordings of a foot in overlapping windows, which limits memory and uses every core.

The length of a stride depends on its two stances and a few neighbours; heading and position only accumulate. So a long
recording is cut at footholds into windows that overlap by `OVERLAP`. Each window is estimated separately, then rotated
and shifted onto the window before it, at a foothold in the middle of the overlap. Stride lengths differ from those of
one run by 0.1 mm, at most 1 mm; headings, whose gyroscope bias is not passed on, drift somewhat more.

Windows are computed in single precision, which takes two thirds of the time and half of the memory. Stride lengths of
recorded feet change by 0.04 mm at most (experiment `foot_ins.speed`).
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.foot_ins.prepare import FOOTHOLDS, FootSignals
from jgait.estimators.foot_ins.readout import Path
from jgait.estimators.interface import Axis, axes_of
from jgait.geometry.rotation import level, turned, yawed
from jgait.types import FootTrajectory, Values

WINDOW, OVERLAP = 2**16, 4096
"""[samples] Length of a window, five and a half minutes at 200 Hz, and of the overlap of two, some twenty strides."""


class Window(NamedTuple):
    """A window of a recording, half-open; only its middle part, `first` to `last`, goes into the joined estimate.

    `holds` are the indices of its footholds, `join` that of the foothold at which the middle part begins.
    """

    start: int
    stop: int
    first: int
    last: int
    holds: np.ndarray
    join: int


def windows(foot: FootSignals, samples: int) -> list[Window] | None:
    """The windows of inputs of T samples, on the host; None if a window has too few footholds for a join."""
    count = int(foot.count)
    holds = np.asarray(foot.foothold)[:count]
    cuts: list[Window] = []
    begin, first, joins = 0, 0, 0
    while True:
        start = int(holds[begin]) if begin else 0
        if samples - start <= WINDOW:
            cuts.append(Window(start, samples, first, samples, np.arange(begin, count), joins))
            return cuts
        end = int(np.searchsorted(holds, start + WINDOW - 1))
        join = int(np.searchsorted(holds, holds[end - 1] - OVERLAP // 2)) if end else 0
        after = int(np.searchsorted(holds, holds[join] - OVERLAP // 2)) if join else 0
        if join <= begin or after <= begin or join >= end:
            return None
        cuts.append(Window(start, start + WINDOW, first, int(holds[join]), np.arange(begin, end), joins))
        begin, first, joins = after, int(holds[join]), join


def cut(foot: FootSignals, window: Window) -> FootSignals:
    """The inputs of one window, padded to the size of all windows."""
    part = slice(window.start, window.stop)
    fields: dict[str, Any] = {}
    for name, axis in axes_of(FootSignals).items():
        fields[name] = values = np.asarray(getattr(foot, name))
        if axis is not None and axis.every > 1:
            inside = values[window.holds]
            if name != "whole":
                inside = np.clip(inside - window.start, 0, WINDOW - 1).astype(np.int32)
            fields[name] = axis.padded(inside, FOOTHOLDS.length(WINDOW) - len(inside))
        elif axis is not None:
            fields[name] = axis.padded(values[part], WINDOW - (window.stop - window.start))
    fields["count"] = np.asarray(len(window.holds), np.int32)
    if at := window.start:
        up = np.asarray(foot.acc)[max(at - 2, 0) : at + 3].mean(axis=0) - foot.acc_bias
        fields |= {"attitude": level(up), "up": up / np.linalg.norm(up)}
        fields["dt"] = np.concatenate([[0.0], fields["dt"][1:]])
    return single(FootSignals(**fields))


def single(values: PyTree) -> PyTree:
    """The same arrays on the host, real numbers in single precision."""
    return jax.tree.map(lambda v: np.asarray(v, np.float32) if np.asarray(v).dtype == np.float64 else v, values)


def joined(
    foot: FootSignals, time: np.ndarray, parts: list[Window],
    estimate: Callable[[FootSignals, np.ndarray], tuple[Path, Values, Values]],
) -> tuple[Path, float, np.ndarray]:  # fmt: skip
    """Path, mean normalised innovation squared and valid samples (T,) of all windows together.

    `estimate` gives them for inputs and times of a window, in parallel on all cores.
    """

    def estimate_window(window: Window) -> PyTree:
        window_time = time[window.start : window.stop]
        seconds = window_time - window_time[0]
        padded = single(Axis("onwards").padded(seconds, WINDOW - seconds.size))
        path, nis, valid = jax.tree.map(
            lambda v: np.asarray(v, time.dtype if v.dtype.kind == "f" else None), estimate(cut(foot, window), padded)
        )
        between = 0.5 * (seconds[1:] + seconds[:-1])
        times = ("start", "final_contact", "end", "standing", "standing_end")
        later = {name: window_time[np.searchsorted(between, getattr(path.strides, name))] for name in times}
        return path._replace(strides=path.strides._replace(**later)), nis, valid

    with ThreadPoolExecutor(max_workers=min(len(parts), os.cpu_count() or 1)) as pool:
        results = list(pool.map(estimate_window, parts))
    path, valid = _together(results, parts)
    return path, float(np.mean([nis for _, nis, _ in results])), valid


def _together(results: list[PyTree], parts: list[Window]) -> tuple[Path, np.ndarray]:
    """The path and the valid samples: each window's rotated and shifted onto the end of the one before it."""
    pieces: list[tuple[Path, np.ndarray]] = []
    ends: tuple[np.ndarray, np.ndarray, float] | None = None  # position, attitude and heading's deviation at the join
    borders = [part.join for part in parts[1:]] + [int(parts[-1].holds[-1])]
    for (path, _, valid), window, border in zip(results, parts, borders, strict=True):
        position, velocity, orientation = path.trajectory
        variance = path.stddev.orientation[:, 2] ** 2
        here, last = window.first - window.start, window.last - window.start
        turn, shift = 0.0, np.zeros(3)
        if ends is not None:
            place, attitude, unsure = ends
            turn = _turn_between(attitude, orientation[here])
            shift = place - turned(position[here], turn)
            variance = np.maximum(variance - variance[here], 0.0) + unsure**2
        moved = FootTrajectory(turned(position, turn) + shift, turned(velocity, turn), yawed(orientation, turn))
        heading = np.sqrt(variance)
        spread = path.stddev._replace(orientation=np.column_stack([path.stddev.orientation[:, :2], heading]))
        at = min(last, len(position) - 1)
        ends = np.asarray(moved.position[at]), np.asarray(moved.orientation[at]), float(heading[at])
        rows, samples = slice(window.join - window.holds[0], border - window.holds[0]), slice(here, last)
        moved, spread, pitch, valid = jax.tree.map(lambda v, at=samples: v[at], (moved, spread, path.pitch, valid))
        strides, deviations = jax.tree.map(lambda v, at=rows: v[at], (path.strides, path.strides_stddev))
        pieces.append((Path(moved, spread, strides, deviations, pitch, path.nis[rows]), valid))
    path, valid = jax.tree.map(lambda *v: np.concatenate(v), *pieces)
    return path, valid


def _turn_between(wanted: np.ndarray, q: np.ndarray) -> float:
    """The rotation about the vertical from attitude `q` to attitude `wanted` of the same tilt [rad]."""
    z = wanted[3] * q[0] - wanted[0] * q[3] + wanted[2] * q[1] - wanted[1] * q[2]
    return float(2.0 * np.arctan2(z, wanted @ q))
