"""How a result was computed: version, estimator, parameters with units, and the parameters that are not default."""

import datetime
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jgait import __version__, io
from jgait.notes import Note, record
from jgait.report.page import Cell, Table, significant


@record
class Made(NamedTuple):
    """How a result was computed: settings of a page; those that are not known stay empty."""

    estimator: str = ""  #: name of the estimator.
    params: PyTree = None  #: the estimator's parameters, a NamedTuple in natural units, or None.
    default: PyTree = None  #: the default parameters, of the same type, or None.
    pipeline: str = ""  #: variant of the estimator, such as "the paper's".
    file: str = ""  #: name of the file or data set.
    command: str = ""  #: command that makes the page again.
    notes: tuple[Note, ...] = ()  #: assumptions in the computation.
    version: str = __version__  #: of jgait, when the result was computed.

    def settings(self) -> list[tuple[str, str]]:
        """Name → value, for the end of the page."""
        values = {
            "jgait": self.version, "estimator": self.estimator, "pipeline": self.pipeline, "data": Path(self.file).name,
            "page made on": datetime.date.today().isoformat(),
        }  # fmt: skip
        return [(name, value) for name, value in values.items() if value]

    def changed(self) -> dict[str, tuple[float, float]]:
        """Name → (value, default) of every parameter that is not at its default."""
        used, usual = flat(self.params), flat(self.default)
        return {name: (used[name], usual[name]) for name in used if name in usual and used[name] != usual[name]}

    def numbers(self) -> dict[str, object]:
        """The settings and parameters as JSON numbers."""
        texts = {name: getattr(self, name) for name in ("estimator", "pipeline", "command", "version")}
        return {**texts, "file": Path(self.file).name, "parameters": flat(self.params), "changed": list(self.changed())}

    def table(self) -> Table | None:
        """All parameters with units, parameters that differ from their default first; None if they are not known."""
        used, usual, changed = flat(self.params), flat(self.default), self.changed()
        if not used:
            return None
        units = io.units(self.params)
        rows = []
        for name in sorted(used, key=lambda known: known not in changed):
            default = Cell(significant(usual[name], 4)) if name in usual else Cell("–")
            words = "not the default" if name in changed else ""
            rows.append([Cell(name), Cell(significant(used[name], 4)), default, Cell(units.get(name, "")), Cell(words)])
        return Table("Parameters of the estimator", ("parameter", "value", "default", "unit", ""), rows, words=2)


def flat(params: PyTree) -> dict[str, float]:
    """Name of every scalar parameter, such as "thigh_length.right" → its value; arrays are left out."""
    leaves = [] if params is None else jax.tree_util.tree_flatten_with_path(params)[0]
    named = {jax.tree_util.keystr(where).lstrip("."): value for where, value in leaves}
    return {name: float(value) for name, value in named.items() if np.ndim(value) == 0}
