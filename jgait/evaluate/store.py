"""Tables of a cohort, and the folder that stores them: batches are appended whole, and a killed run can be continued.

Every finished batch is a folder of CSV files, written under a name that begins with a dot and then renamed. Renaming
is atomic: if the process is killed at any moment, only the unfinished batch is lost.
"""

import json
import os
import shutil
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from jaxtyping import PyTree

from jgait.evaluate.statistics import agreement
from jgait.notes import from_json, record
from jgait.types import people

if TYPE_CHECKING:
    import pandas as pd

COLUMNS: dict[str, tuple[str, ...]] = {
    "recordings": ("recording", "subject", "n_samples", "seconds", "valid", "notes"),
    "quantities": ("recording", "subject", "quantity", "estimate", "reference", "error", "abs_error", "rel_error"),
    "strides": (
        "recording", "subject", "s_id", "side", "start", "end", "regular",
        "quantity", "estimate", "reference", "error", "abs_error", "rel_error",
    ),
    "failures": ("recording", "subject", "reason"),
}  # fmt: skip
"""Columns of each table of a `Cohort`."""

REGULAR = "regular_"
"""Begin of the name of a quantity of regular strides alone, in tables of agreement."""

_TEXT = ("recording", "subject", "quantity", "side", "notes", "reason")
_TYPES = {**dict.fromkeys(_TEXT, "str"), "n_samples": "int64", "s_id": "int64", "regular": "bool"}
_DESCRIPTION = "cohort.json"
_PARTS = {
    "jgait": "the version of jgait", "estimator": "the estimator", "functions": "the estimator's options",
    "params": "the parameters", "body": "the measures of a person", "with_body": "the measures of a person",
    "read": "how files are read", "score": "the comparison with the reference", "precision": "the precision",
}  # fmt: skip
"""Part of the description of an evaluation → its meaning."""


class OtherEvaluationError(ValueError):
    """A folder holds results of an evaluation with other data or settings."""


@record
class Cohort(NamedTuple):
    """Results of an estimator on a cohort; pandas tables, sorted by recording, with the columns of `COLUMNS`."""

    #: a row a recording; `valid` is the share of samples with an estimate [1]; `notes` are JSON, see `notes.from_json`.
    recordings: "pd.DataFrame"
    #: a row a recording and quantity, in the unit at the end of the quantity's name, without one in SI units; NaN where
    #: there is no reference.
    quantities: "pd.DataFrame"
    #: a row a stride of the reference and quantity; `start end` [s]; `regular`: the estimated stride has no flag that
    #: leaves the quantity out: a turn, stairs, a half-step, an uneven duration, or a doubt about this quantity.
    strides: "pd.DataFrame"
    failures: "pd.DataFrame"  #: every recording without a result, and the reason.

    def usable(self) -> "Cohort":
        """The cohort without recordings whose notes say not to use any result, such as of people who do not walk."""
        grave = [
            any(note.severity == "stop" and not note.kind.measure for note in from_json(notes))
            for notes in self.recordings["notes"]
        ]
        left_out = self.recordings.loc[grave, "recording"]
        recordings, quantities, strides = (
            rows[~rows["recording"].isin(left_out)].reset_index(drop=True) for rows in self[:3]
        )
        return Cohort(recordings, quantities, strides, self.failures)

    def paired(self) -> "pd.DataFrame":
        """All rows that have a reference, of recordings and of strides, in one long table."""
        import pandas as pd

        shared = list(COLUMNS["quantities"])
        rows = pd.concat([self.quantities[shared], self.strides[shared]], ignore_index=True)
        return rows[rows["reference"].notna()].reset_index(drop=True)

    def by_subject(self) -> "pd.DataFrame":
        """Means over each subject's recordings or strides, a row a subject and quantity; `n` counts the errors."""
        rows = self.paired()
        groups = rows.groupby(["subject", "quantity"], sort=True)
        means = groups[["estimate", "reference", "error", "abs_error", "rel_error"]].mean()
        means.insert(0, "n", groups["error"].count())
        return means.reset_index()

    def agreement(self, **settings: PyTree) -> "pd.DataFrame":
        """Bias, limits of agreement and ICC of every quantity that has a reference.

        Quantities of strides have a row of all strides, such as `stride_length_m`, and, where some are not `regular`,
        one of those that are, `regular_stride_length_m`. Half-steps from and to standing are much shorter than other
        strides, so that they make the ICC of lengths larger, and errors in turns make limits wider: report both.

        Args:
            settings: `seed` and `resamples`, as of `jgait.evaluate.agreement`.
        """
        import pandas as pd

        every, strides = self.paired(), self.strides[self.strides[["estimate", "reference"]].notna().all(axis=1)]
        uneven = strides["quantity"].isin(strides.loc[~strides["regular"], "quantity"])
        strides = strides[uneven & strides["regular"]]
        regular = strides.assign(quantity=REGULAR + strides["quantity"])[every.columns]
        table = agreement(pd.concat([every, regular], ignore_index=True), **settings)
        names = every["quantity"].unique()
        order = [name for both in zip(names, REGULAR + names, strict=True) for name in both]
        return table.loc[[name for name in order if name in table.index]]


def frame(table: str, rows: "Sequence[Any] | dict[str, Any] | pd.DataFrame") -> "pd.DataFrame":
    """A data frame with the columns of the named table, in their types, equal in memory and on disk."""
    import pandas as pd

    made = pd.DataFrame(rows, columns=list(COLUMNS[table])).reset_index(drop=True)
    return made.astype({name: _TYPES.get(name, "float64") for name in made.columns})


def joined(parts: Iterable[Cohort]) -> Cohort:
    """Several cohorts as one, sorted by recording, with one name a person; rows of a recording keep their order."""
    import pandas as pd

    parts = list(parts)
    tables = []
    for name in Cohort._fields:
        filled = [part for cohort in parts if len(part := getattr(cohort, name))]
        whole = pd.concat(filled, ignore_index=True) if filled else frame(name, {})
        tables.append(whole.sort_values("recording", kind="stable", ignore_index=True))
    subjects = pd.unique(pd.concat([table["subject"] for table in tables]))
    name_of = dict(zip(subjects, people(subjects), strict=True))
    return Cohort(*(table.assign(subject=table["subject"].map(name_of).astype(str)) for table in tables))


class Folder:
    """Tables that grow on disk, a folder of CSV files a batch."""

    def __init__(self, path: Path, description: dict[str, str], rank: int = 0) -> None:
        """Make the folder, or continue that of an earlier run with the same settings, as the process with this rank.

        Raises:
            ValueError: if the folder holds results of another description, or other files.
        """
        self._path, self._rank = Path(path), rank
        self._path.mkdir(parents=True, exist_ok=True)
        known = self._path / _DESCRIPTION
        if not known.exists():
            foreign = sorted(p.name for p in self._path.iterdir() if not p.name.startswith("."))
            if foreign:
                raise ValueError(f"out must be empty or hold a cohort; {self._path} holds {', '.join(foreign[:3])}")
            hidden = self._path / f".{rank}-{_DESCRIPTION}"
            _write(hidden, json.dumps(description, indent=1, sort_keys=True, ensure_ascii=False))
            hidden.replace(known)
        before = json.loads(known.read_text(encoding="utf-8"))
        if differences := _differences(before, description):
            raise OtherEvaluationError(
                f"{self._path} holds results of another evaluation, which differs in {differences}; give another "
                "folder as out, or delete this one"
            )
        for left in self._path.glob(f".{rank}-part-*"):
            shutil.rmtree(left)
        numbers = [int(p.name.rsplit("-", 1)[1]) for p in self._parts() if p.name.startswith(f"part-{rank}-")]
        self._next = max(numbers, default=-1) + 1
        self._done: dict[Path, frozenset[str]] = {}

    def _parts(self) -> list[Path]:
        return sorted(self._path.glob("part-*-*"))

    def done(self) -> frozenset[str]:
        """Recordings that are finished, those that failed included."""
        for part in self._parts():
            if part not in self._done:
                tables = (read_table(part / f"{table}.csv", table) for table in ("recordings", "failures"))
                self._done[part] = frozenset(name for table in tables for name in table["recording"])
        return frozenset[str]().union(*self._done.values())

    def wait(self, names: set[str]) -> None:
        """Wait until all these recordings are finished, those of other processes too."""
        while not names <= self.done():
            time.sleep(0.5)

    def append(self, part: Cohort) -> None:
        """Add the rows of a batch: all rows, or none if the process is killed meanwhile."""
        name = f"part-{self._rank}-{self._next:06d}"
        hidden = self._path / f".{self._rank}-{name}"
        hidden.mkdir()
        for table in Cohort._fields:
            _write(hidden / f"{table}.csv", getattr(part, table).to_csv(index=False, na_rep="nan", lineterminator="\n"))
        hidden.rename(self._path / name)
        self._next += 1

    def tables(self) -> Cohort:
        """All rows so far, those of other processes included."""
        return joined(
            Cohort(*(read_table(part / f"{table}.csv", table) for table in Cohort._fields)) for part in self._parts()
        )


def _differences(there: dict[str, str], here: dict[str, str]) -> str:
    """What differs between two descriptions, in words; "" if nothing does. Another estimator differs in all else."""
    differ = [name for name in sorted({*there, *here}) if there.get(name) != here.get(name)]
    words = []
    for name in ["estimator"] if "estimator" in differ else differ:
        before, now = there.get(name, "none"), here.get(name, "none")
        words.append(_PARTS.get(name, name) + (f" ({before}; now {now})" if max(len(before), len(now)) <= 100 else ""))
    return ", ".join(dict.fromkeys(words))


def _write(path: Path, text: str) -> None:
    """Write a text, on the disk when this returns."""
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def read_table(path: Path, table: str) -> "pd.DataFrame":
    """One of the tables of a `Cohort` from a CSV file; empty cells of numbers are NaN. Raises FileNotFoundError without
    the file, ValueError if it lacks a column, or has text instead of numbers.
    """
    import pandas as pd

    # Cells are read as text and converted by Python: exact in every version of pandas, and a subject may be named NA.
    text = pd.read_csv(path, dtype=str, keep_default_na=False, encoding="utf-8")
    if lacking := [name for name in COLUMNS[table] if name not in text]:
        raise ValueError(f"{path.name} has no column {lacking[0]!r}")

    def cells(name: str) -> Sequence[Any]:
        if _TYPES.get(name) == "bool":
            return [cell == "True" for cell in text[name]]
        return list(text[name]) if name in _TEXT else [float(cell or "nan") for cell in text[name]]

    return frame(table, {name: cells(name) for name in COLUMNS[table]})
