"""The parts of a page, and the self-contained HTML file with these parts."""

import base64
import hashlib
import html
import io
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from jgait import __version__
from jgait.io.atomic import write_text
from jgait.io.flags import GRADES, Flag
from jgait.notes import printable
from jgait.plot.style import ready
from jgait.types import Values

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LARGEST_SVG = 150_000
"""[bytes] Largest SVG drawing; larger drawings, with tens of thousands of points, are stored as pixels."""


class Cell(NamedTuple):
    """A cell: its text, and the number by which its column is sorted (None: by its text)."""

    text: str
    value: float | None = None


class Table(NamedTuple):
    """A table."""

    caption: str  #: the content of the table, and how to read it.
    columns: Sequence[str]  #: headings, with units.
    rows: Sequence[Sequence[Cell]]  #: of cells; the first of each names the row.
    sortable: bool = False  #: whether a click on a heading sorts it.
    words: int = 0  #: number of last columns with words, which are aligned left.


class Picture(NamedTuple):
    """A figure: its data address, what it shows (for those who cannot see it), and how to read it."""

    address: str
    alt: str
    caption: str


class Section(NamedTuple):
    """A part of the page: heading, a paragraph or none, then tables and pictures in order."""

    heading: str
    text: str = ""
    parts: Sequence[Table | Picture] = ()


@dataclass(frozen=True, repr=False)
class Report:
    """A page that loads nothing from other addresses, and its numbers; a notebook shows it in a frame."""

    title: str  #: name of the recording or the cohort.
    kind: str  #: kind of the page, above the title.
    lead: str  #: a sentence that states how the results were computed.
    facts: Sequence[tuple[str, str, str]]  #: (name, value with its unit, its sensors) of the most important numbers.
    verdict: str  #: a sentence on how far to trust them.
    flags: Sequence[Flag]  #: flags, the most serious first.
    caption: str  #: how the numbers are computed.
    sections: Sequence[Section]  #: the other parts of the page, in order.
    settings: Sequence[tuple[str, str]]  #: settings of the computation, name → value.
    command: str  #: command that makes the page again, "" where it is not known.
    numbers: dict[str, Any]  #: the content for programs, as JSON numbers.

    @cached_property
    def html(self) -> str:
        """The page as HTML, with a policy that forbids all connections. Raises ImportError without the extra `cli`."""
        try:
            import jinja2
            from markupsafe import Markup
        except ImportError as missing:
            raise ImportError(f"reports need the extra cli: pip install 'jgait[cli]' ({missing})") from missing
        folder = resources.files("jgait.report") / "templates"
        style, script = (folder.joinpath(name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
        # The policy allows only the script with this digest: a script in the text of a table cannot run.
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        environment = jinja2.Environment(
            loader=jinja2.PackageLoader("jgait.report", "templates"), autoescape=True, undefined=jinja2.StrictUndefined,
            finalize=lambda value: printable(value) if type(value) is str else value, trim_blocks=True,
            lstrip_blocks=True,
        )  # fmt: skip
        # The first figure stands beside the numbers, on the first screen.
        first = next((part for section in self.sections for part in section.parts if isinstance(part, Picture)), None)
        sections = [section._replace(parts=[part for part in section.parts if part is not first])
                    for section in self.sections if list(section.parts) != [first]]  # fmt: skip
        return environment.get_template("page.html").render(
            page=replace(self, sections=sections), first=first, style=Markup(style), script=Markup(script),
            digest=digest, grades=GRADES, version=__version__,
        )  # fmt: skip

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the page, completely or not at all, into a folder that exists; returns the path."""
        return write_text(path, self.html)

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{html.escape(self.html)}" width="100%" height="800" title="jgait report"></iframe>'


def picture(figure: "Figure", alt: str, caption: str) -> Picture:
    """A figure as part of a page: an SVG drawing up to `LARGEST_SVG`, else pixels; `alt` is for those who cannot see
    it.
    """
    import matplotlib

    stream = io.BytesIO()
    with ready(figure), matplotlib.rc_context({"svg.hashsalt": "jgait"}):  # the same figure gives the same bytes
        figure.savefig(stream, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    kind, data = "svg+xml", stream.getvalue()
    if len(data) > LARGEST_SVG:
        from PIL import Image

        stream, small = io.BytesIO(), io.BytesIO()
        with ready(figure):
            figure.savefig(stream, format="png", dpi=120, metadata={"Software": None})
        # a figure has few colours: a quarter of the size
        Image.open(stream).convert("RGB").quantize(96).save(small, format="png", optimize=True)
        kind, data = "png", small.getvalue()
    return Picture(f"data:image/{kind};base64,{base64.b64encode(data).decode()}", alt, caption)


def number(value: Values, digits: int) -> str:
    """A number as the page shows it; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    # a difference that is rounded to 0 is shown without a sign
    return f"{value:z.{digits}f}".replace("-", "−")


def significant(value: Values, digits: int = 3) -> str:
    """A number with the given number of significant digits."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{digits}g}".replace("-", "−")


def cell(value: Values, digits: int, spread: Values | None = None) -> Cell:
    """A number, with its standard deviation where there is one."""
    if value is None or not math.isfinite(value):
        return Cell("–", math.nan)
    known = spread is not None and math.isfinite(spread)
    return Cell(number(value, digits) + (f" ± {number(spread, digits)}" if known else ""), float(value))
