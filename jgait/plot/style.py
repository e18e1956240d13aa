"""Shared by all figures: colours and lines that also differ in grey, empty figures, bands, windows, legends, files.

Estimates are red, references black and dashed; right is black, left is light blue. Matplotlib is imported only when a
figure is drawn, and needs no display.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jgait.io.atomic import replaced
from jgait.notes import printable
from jgait.types import AnyArray, as_float

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
else:
    Axes = Figure = Any

type Style = dict[str, Any]
"""Keyword arguments of matplotlib."""

type Seconds = tuple[float, float] | None
"""From and to [s]; None: everything."""

RED, BLUE = "#c0392b", "#6fb1e0"
DASHED = (0, (4, 2))
"""Dashes of references and limits [widths of the line]."""

ESTIMATE: Style = {"color": RED, "linewidth": 1.4}
"""Line of an estimate."""

REFERENCE: Style = {"color": "black", "linewidth": 1.2, "linestyle": DASHED}
"""Line of a reference."""

AXES: tuple[Style, ...] = (
    {"color": "black", "linewidth": 1.3, "linestyle": "-"},
    {"color": RED, "linewidth": 1.3, "linestyle": (0, (4, 1.5))},
    {"color": BLUE, "linewidth": 1.7, "linestyle": "-"},
)
"""Lines of x, y and z; they differ in lightness and dashes, also in grey."""

FOOT: dict[str, Style] = {"right": {"color": "black", "linewidth": 1.1}, "left": {"color": BLUE, "linewidth": 1.6}}
"""Side → line of its foot."""

FOOTHOLD: dict[str, Style] = {
    "right": {"marker": "o", "color": "black", "markersize": 4.0, "linestyle": "none"},
    "left": {"marker": "s", "color": BLUE, "markersize": 4.5, "markeredgecolor": "#2b6a99", "linestyle": "none"},
}
"""Side → mark of an event of this foot; the marks differ in lightness and shape, also in grey."""

GROUND: Style = {"linewidth": 0.0, "zorder": 0.0}
"""Style of a time interval that is shaded behind the lines."""


def blank(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple[Figure, np.ndarray]:
    """A figure of width and height [inch] that needs no display, and its axes (rows, columns)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def panels(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple[Figure, np.ndarray]:
    """As `blank`, with a grid."""
    figure, axes = blank(rows, columns, width, height, **options)
    for axis in axes.ravel():
        axis.grid(alpha=0.3)
    return figure, axes


def single(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure with one pair of axes, as `blank`."""
    figure, axes = blank(1, 1, width, height)
    return figure, axes[0, 0]


def windowed(time: AnyArray, seconds: Seconds) -> np.ndarray:
    """(T,) True where a time lies in the window."""
    time, (first, last) = as_float(time), seconds or (-np.inf, np.inf)
    return (time >= first) & (time <= last)


def check_overlap(time: AnyArray, seconds: tuple[float, float]) -> None:
    """Refuse a window in which no sample lies. Raises ValueError with the times of the recording and of the window."""
    time = as_float(time)
    if not windowed(time, seconds).any():
        raise ValueError(f"seconds must overlap the recording, {time[0]:g} to {time[-1]:g}; got {seconds}")


def band(
    axis: Axes, x: AnyArray, values: AnyArray, deviation: AnyArray, *, label: str | None = "±2σ", **style: Any
) -> None:
    """Draw a filled band of two standard deviations about the values."""
    spread = 2.0 * as_float(deviation)
    axis.fill_between(x, as_float(values) - spread, as_float(values) + spread, linewidth=0.0, label=label, **style)


def legend(figure: Figure, title: str, *, columns: int = 4) -> None:
    """Add one legend below all axes, with each label once, and the title above; align the labels of the y axes."""
    entries: dict[str, Any] = {}
    for axis in figure.axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(entries.values(), entries, loc="outside lower center", ncols=columns, fontsize=8, frameon=False)
    figure.align_ylabels()
    if title:
        figure.suptitle(title, fontsize=11)


def _texts(artist: Any) -> Iterator[Any]:
    """The texts of an artist, without the numbers beside the axes, which are made when a figure is drawn."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text
    from matplotlib.ticker import ScalarFormatter

    if isinstance(artist, Text):
        yield artist
    numbers = isinstance(artist, Axis) and isinstance(artist.get_major_formatter(), ScalarFormatter)
    for child in [artist.label, artist.offsetText] if numbers else artist.get_children():
        yield from _texts(child)


@contextlib.contextmanager
def ready(figure: Figure) -> Iterator[None]:
    """In the block a figure is laid out, and its texts are shown as they are, also with dollar signs or control
    characters.
    """
    import matplotlib

    for text in _texts(figure):
        text.set_parse_math(False)
        text.set_text(printable(text.get_text()))
    layout = figure.get_layout_engine()
    with matplotlib.rc_context({"text.parse_math": False}):
        if layout is not None:
            layout.execute(figure)
        figure.set_layout_engine(None)  # with one, matplotlib lays out again, and draws twice
        try:
            yield
        finally:
            figure.set_layout_engine(layout)


def save(figure: Figure, path: str | Path, *, dpi: int = 130) -> Path:
    """Write a figure, its texts without formulas, to a file in the format of its ending, whole or not at all; gives the
    path.
    """
    with ready(figure), replaced(path) as part:
        # In two thirds of the time of zlib's own choice; the files are up to a third larger.
        fast: Style = {"pil_kwargs": {"compress_level": 3}} if part.suffix.lower() == ".png" else {}
        figure.savefig(part, dpi=dpi, **fast)
    return Path(path)
