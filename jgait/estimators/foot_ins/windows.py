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

from jgait.estimators.foot_ins.inputs import FootSignals, capacity
from jgait.estimators.foot_ins.readout import Path
from jgait.estimators.interface import Axis, axes_of
from jgait.geometry.rotation import level, turned, yawed
from jgait.types import FootTrajectory, Values

WINDOW = 2**16
"""[samples] Length of a window; five and a half minutes at 200 Hz."""

OVERLAP = 4096
"""[samples] Overlap of two windows; some twenty strides at 200 Hz."""

_TIMES = ("start", "final_contact", "end", "standing", "standing_end")


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
        last = int(holds[join])
        cuts.append(Window(start, start + WINDOW, first, last, np.arange(begin, end), joins))
        begin, first, joins = after, last, join


def cut(foot: FootSignals, window: Window) -> FootSignals:
    """The inputs of one window, padded to the size of all windows."""
    part = slice(window.start, window.stop)
    missing = WINDOW - (window.stop - window.start)
    rows = capacity(WINDOW)
    fields: dict[str, Any] = {}
    for name, axis in axes_of(FootSignals).items():
        values = np.asarray(getattr(foot, name))
        if axis is None:
            fields[name] = values
        elif axis.length is capacity:
            inside = values[window.holds]
            if name != "whole":
                inside = np.clip(inside - window.start, 0, WINDOW - 1).astype(np.int32)
            fields[name] = axis.padded(inside, rows - len(inside))
        else:
            fields[name] = axis.padded(values[part], missing)
    fields["count"] = np.asarray(len(window.holds), np.int32)
    if window.start:
        at = window.start
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
        path, nis, valid = estimate(cut(foot, window), padded)
        path, nis, valid = jax.tree.map(
            lambda v: np.asarray(v, time.dtype if v.dtype.kind == "f" else None), (path, nis, valid)
        )
        between = 0.5 * (seconds[1:] + seconds[:-1])
        later = {name: window_time[np.searchsorted(between, getattr(path.strides, name))] for name in _TIMES}
        return path._replace(strides=path.strides._replace(**later)), nis, valid

    with ThreadPoolExecutor(max_workers=min(len(parts), os.cpu_count() or 1)) as pool:
        results = list(pool.map(estimate_window, parts))
    return _together(results, parts)


def _together(results: list[PyTree], parts: list[Window]) -> tuple[Path, float, np.ndarray]:
    pieces: list[tuple[Path, np.ndarray]] = []
    # position and attitude at the last join, and deviation of the heading there [rad]
    join: tuple[np.ndarray, np.ndarray, float] | None = None
    for number, ((path, _, valid), window) in enumerate(zip(results, parts, strict=True)):
        position, velocity, orientation = path.trajectory
        of_heading = path.stddev.orientation[:, 2] ** 2
        here, end = window.first - window.start, window.last - window.start
        turn, shift, known, unsure = 0.0, np.zeros(3), 0.0, 0.0
        if join is not None:
            place, attitude, unsure = join
            turn = _turn_between(attitude, orientation[here])
            shift, known = place - turned(position[here], turn), of_heading[here]
        way, facing = turned(position, turn) + shift, yawed(orientation, turn)
        moved = FootTrajectory(way, turned(velocity, turn), facing)
        heading = np.sqrt(np.maximum(of_heading - known, 0.0) + unsure**2)
        spread = path.stddev._replace(orientation=np.column_stack([path.stddev.orientation[:, :2], heading]))
        last = min(end, len(position) - 1)
        join = (np.asarray(way[last]), np.asarray(facing[last]), float(heading[last]))
        low = window.join - window.holds[0]
        high = len(window.holds) - 1 if number + 1 == len(parts) else parts[number + 1].join - window.holds[0]
        by_sample, by_stride = (moved, spread, path.pitch, valid), (path.strides, path.strides_stddev, path.nis)
        moved, spread, pitch, valid = jax.tree.map(lambda v, at=slice(here, end): v[at], by_sample)
        strides, deviations, nis = jax.tree.map(lambda v, at=slice(low, high): v[at], by_stride)
        pieces.append((Path(moved, spread, strides, deviations, pitch, nis), valid))
    path, valid = jax.tree.map(lambda *v: np.concatenate(v), *pieces)
    return path, float(np.mean([nis for _, nis, _ in results])), valid


def _turn_between(wanted: np.ndarray, q: np.ndarray) -> float:
    """The rotation about the vertical from attitude `q` to attitude `wanted` of the same tilt [rad]."""
    w = wanted @ q
    z = wanted[3] * q[0] - wanted[0] * q[3] + wanted[2] * q[1] - wanted[1] * q[2]
    return float(2.0 * np.arctan2(z, w))
