"""The page of a cohort."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import PyTree

from jgait.estimators import about_of
from jgait.evaluate import Cohort
from jgait.evaluate.store import REGULAR
from jgait.notes import from_json, listed, of_recordings
from jgait.plot import cohort as plot_cohort
from jgait.report import flags
from jgait.report.made import Made
from jgait.report.page import (
    Cell,
    Content,
    Flag,
    Picture,
    Report,
    Section,
    Table,
    cell,
    number,
    picture,
    significant,
    without_folders,
)
from jgait.report.recording import readable

if TYPE_CHECKING:
    import pandas as pd

DRAWN = ("distance_m", "stride_length_m", "stride_width_m", "walking_speed_mps", "stride_duration_s")
"""Quantities with figures, where two people or more have them."""

BY_SUBJECT = ("distance_m", "stride_length_m", "walking_speed_mps", "stride_width_m")
"""Quantities in the table of people."""

MOST_RECORDINGS = 2000
"""Largest number of rows in the table of recordings; more rows make the page slow."""

HOW = (
    "Difference between estimate and reference against the mean of both; of strides, all are drawn. The full line is "
    "the bias; between the dashed lines 95 of 100 differences are expected. Bars beside the axes are 95 % intervals."
)

TUNED = ("not_held_out", "held_out")
"""Codes of the notes whether parameters were tuned on the recordings."""

FEW_PEOPLE = 10
"""Smallest number of people without a warning that the limits of agreement are uncertain."""


def of_cohort(cohort: Cohort, *, title: str = "cohort", made: Made | None = None) -> Report:
    """The page of a cohort: agreement with the reference, Bland–Altman, people, recordings, and failures.

    Args:
        cohort: result of `jgait.evaluate.cohort`.
        title: name of the cohort.
        made: how the results were made; None leaves this out.

    Raises:
        ValueError: if the cohort has no recording, neither used nor failed.
        ImportError: without the extra `cli`.
    """
    made = Made() if made is None else made
    failures = [
        (without_folders(str(name)), without_folders(str(reason)))
        for name, reason in zip(cohort.failures["recording"], cohort.failures["reason"], strict=True)
    ]
    if not len(cohort.recordings) and not failures:
        raise ValueError("a report needs recordings; the cohort has none, not even one that failed")
    usable = cohort.usable()
    paired, agreement = usable.paired(), usable.agreement()
    raised = flags.ordered([*_doubts(cohort, usable, paired), *_notes(cohort, made)])
    used, people = len(cohort.recordings), cohort.recordings["subject"].nunique()
    facts = [
        ("Recordings used", f"{used} of {used + len(failures)}", f"of {people} people"),
        ("Recorded time", f"{number(float(cohort.recordings['seconds'].sum()), 0)} s", "of the recordings used"),
        *_headline(paired, agreement),
    ]  # fmt: skip
    sections = [
        _agreement(agreement, made), Section("Bland–Altman", HOW, _figures(paired)) if len(paired) else None,
        _people(cohort, paired), _recordings(cohort), _failures(failures), _parameters(made),
    ]  # fmt: skip
    about = about_of(made.estimator).title
    lead = f"{about}, compared with an independent measurement." if len(paired) else f"{about}; no reference is known."
    numbers = {
        "kind": "cohort", "cohort": title, "recordings": used, "people": people, "failures": dict(failures),
        "agreement": agreement.astype(object).to_dict("index"), "flags": [flag._asdict() for flag in raised],
        "people_table": usable.by_subject().to_dict("records"), "made": made.numbers(),
    }  # fmt: skip
    return Report(Content(
        Path(title).name, "Cohort report", lead, facts, flags.verdict(raised), raised,
        [section for section in sections if section is not None], made.settings(), made.command, numbers,
    ))  # fmt: skip


def _doubts(cohort: Cohort, usable: Cohort, paired: "pd.DataFrame") -> Iterator[Flag]:
    """The flags of recordings that are in no number, of a missing reference and of few people."""
    used, failed, kept = (len(rows) for rows in (cohort.recordings, cohort.failures, usable.recordings))
    biased = "because of how a person walks, the others are a biased sample."
    if failed:
        meaning = f"They are in none of the numbers; the reasons are listed below. If recordings fail {biased}"
        yield Flag("check" if used else "stop", f"{of_recordings(failed, used + failed)} could not be used", meaning)
    if kept < used:
        text = f"{of_recordings(used - kept, used, 'is', 'are')} not compared: the result should not be used"
        meaning = (
            f"The table has them, with the reason; they are in none of the errors. If results are not usable {biased}"
        )
        yield Flag("check", text, meaning)
    compared = paired.loc[paired["estimate"].notna()]
    without, people = kept - compared["recording"].nunique(), compared["subject"].nunique()
    if kept and without == kept:
        meaning = "This cohort cannot show how well the numbers agree with the truth."
        yield Flag("check", "No recording has a reference", meaning)
    elif without:
        meaning = "They are in the table of recordings and in none of the comparisons."
        yield Flag("info", f"{of_recordings(without, kept, 'has', 'have')} no reference", meaning)
    if 0 < people < FEW_PEOPLE:
        meaning = "Limits of agreement of few people are uncertain themselves; their intervals are drawn beside them."
        yield Flag("check", f"Only {people} {'person' if people == 1 else 'people'} compared", meaning)


def _notes(cohort: Cohort, made: Made) -> list[Flag]:
    """The notes of readers and estimators by meaning: the number of recordings, and one of the notes."""
    counts: Counter[tuple[str, str]] = Counter()
    example: dict[tuple[str, str], str] = {}
    for name, text in zip(cohort.recordings["recording"], cohort.recordings["notes"], strict=True):
        lines = {
            (flag.grade, flag.meaning): f"{without_folders(str(name))}: {listed(flag.text.splitlines())}"
            for flag in _noted(str(text))
        }
        counts.update(lines.keys())
        example = lines | example
    gathered = [
        Flag(grade, f"{of_recordings(count, len(cohort.recordings))}, such as {example[grade, meaning]}", meaning)
        for (grade, meaning), count in counts.most_common()
    ]
    # a "stop" of a single recording does not make the cohort unusable
    gathered = [flag._replace(grade="check") if flag.grade == "stop" else flag for flag in gathered]
    return [*flags.explained(made.notes), *gathered]


def _noted(text: str) -> list[Flag]:
    """The notes of a recording that are more than information."""
    return [flag for flag in flags.explained(from_json(text)) if flag.grade != "info"]


def _headline(paired: "pd.DataFrame", agreement: "pd.DataFrame") -> list[tuple[str, str, str]]:
    """Bias and limits of the distance and of the length of regular strides, and the distance's relative error."""
    facts = []
    for name in (DRAWN[0], REGULAR + DRAWN[1]):
        if name in agreement.index and np.isfinite(agreement.loc[name, ["bias", "loa_low"]].to_numpy(float)).all():
            words, unit = readable(name)
            row = agreement.loc[name]
            limits = f"95 % limits of agreement {_span(row['loa_low'], row['loa_high'])} {unit}"
            facts.append((f"{words.capitalize()}: bias", f"{significant(row['bias'])} {unit}", limits))
    relative = paired.loc[paired["quantity"] == "distance_m", "rel_error"].abs().dropna()
    if len(relative):
        facts.append(("Distance: mean |error|", f"{number(100.0 * float(relative.mean()), 1)} %", "of the reference"))
    return facts


def _agreement(agreement: "pd.DataFrame", made: Made) -> Section | None:
    """Bias, limits and ICC of every quantity, and errors of whole curves; and whether parameters were tuned on them."""
    rows, curves = [], []
    for name, row in agreement.iterrows():
        if not row["n"]:
            continue
        words, unit = readable(str(name))
        words = f"{words} [{unit}]" if unit else words
        many = Cell(f"{row['n']:.0f} / {row['n_subjects']:.0f}", float(row["n"]))
        if "_rmse_" in str(name):
            curves.append([Cell(words), many, *(_significant(row[c]) for c in ("bias", "max_abs"))])
            continue
        rows.append([
            Cell(words), many, _interval(row, "bias"), Cell(_span(row["loa_low"], row["loa_high"]), row["loa_high"]),
            _interval(row, "mae"), _significant(row["max_abs"]), _interval(row, "icc"),
        ])  # fmt: skip
    parts = []
    if rows:
        caption = (
            "Estimate − reference, each quantity in its own unit; in brackets 95 % intervals, over people. ICC(2,1) "
            "compares with how much the people differ: 1 is perfect, and – where the reference does not vary. Regular "
            "strides are in no turn, on no stairs, no half-step, not uneven and not in doubt; half-steps from and to "
            "standing make the ICC of all strides' lengths larger."
        )
        columns = ("quantity", "n / people", "bias", "95 % limits", "mean |error|", "worst |error|", "ICC(2,1)")
        parts.append(Table(caption, columns, rows))
    if curves:
        caption = "Root mean square difference of whole curves, over recordings."
        parts.append(Table(caption, ("curve", "n / people", "mean", "worst"), curves))
    tuned = " ".join(f"{note.text[:1].upper()}{note.text[1:]}." for note in made.notes if note.code in TUNED)
    return Section("Agreement with the reference", tuned, parts) if parts else None


def _significant(value: float) -> Cell:
    return Cell(significant(value), float(value))


def _span(low: float, high: float) -> str:
    return "–" if not np.isfinite([low, high]).all() else f"{significant(low)} to {significant(high)}"


def _interval(row: PyTree, name: str) -> Cell:
    inside = _span(row[f"{name}_low"], row[f"{name}_high"])
    return Cell(significant(row[name]) + (f"\n({inside})" if inside != "–" else ""), float(row[name]))


def drawn(paired: "pd.DataFrame") -> Iterator[tuple[str, "pd.DataFrame", str, str]]:
    """Name, comparisons, words and unit of the quantities of `DRAWN` that two people or more have."""
    for name in DRAWN:
        rows = paired[(paired["quantity"] == name) & paired["estimate"].notna()]
        if rows["subject"].nunique() > 1:
            words, unit = readable(name)
            yield name, rows.assign(quantity=words), words, unit


def _figures(paired: "pd.DataFrame") -> list[Picture]:
    made = []
    for _, rows, words, unit in drawn(paired):
        alt = f"Bland–Altman plot of {words}, {len(rows)} comparisons of {rows['subject'].nunique()} people"
        caption = f"Bland–Altman plot of {words}."
        made.append(picture(plot_cohort.bland_altman(rows, words, unit=unit), alt, caption))
        alt = f"Absolute errors of {words} of each person"
        caption = f"Absolute errors of {words} by person, the best on top."
        made.append(picture(plot_cohort.per_subject(rows, words, unit=unit), alt, caption))
    return made


def _people(cohort: Cohort, paired: "pd.DataFrame") -> Section:
    """One row for each person: recordings used and failed, and mean errors."""
    lost = Counter(map(str, cohort.failures["subject"].fillna("")))
    used = cohort.recordings.groupby("subject")["recording"].count()
    quantities = [name for name in BY_SUBJECT if paired.loc[paired["quantity"] == name, "error"].notna().any()]
    errors = {
        name: paired[paired["quantity"] == name].groupby("subject")[["error", "abs_error"]].mean()
        for name in quantities
    }
    rows = []
    for subject in sorted({*map(str, used.index), *(name for name in lost if name)}):
        cells = [Cell(subject), _count(used.get(subject, 0)), _count(lost.get(subject, 0))]
        for name in quantities:
            mean = errors[name].loc[subject] if subject in errors[name].index else {"error": None, "abs_error": None}
            cells += [cell(mean["error"], 3), cell(mean["abs_error"], 3)]
        rows.append(cells)
    heads = []
    for name in quantities:
        words, unit = readable(name)
        heads += [f"{words}: mean error [{unit}]", f"mean |error| [{unit}]"]
    caption = "Estimate − reference, mean over each person's recordings or strides. A click on a heading sorts."
    unknown = lost.get("", 0)
    failed = f"{unknown} recordings that failed belong" if unknown > 1 else "One recording that failed belongs"
    text = f"{failed} to nobody who is known." if unknown else ""
    return Section("People", text, [Table(caption, ("person", "used", "failed", *heads), rows, True)])


def _count(value: PyTree) -> Cell:
    return Cell(str(int(value)), float(value))


def _recordings(cohort: Cohort) -> Section:
    """One row for each recording: its length, the share with results, its notes."""
    way = cohort.quantities[cohort.quantities["quantity"] == "distance_m"].set_index("recording")
    rows = []
    for row in cohort.recordings.head(MOST_RECORDINGS).itertuples():
        known = way.loc[row.recording] if row.recording in way.index else {"estimate": None, "reference": None}
        rows.append([
            Cell(without_folders(str(row.recording))), Cell(str(row.subject)), cell(row.seconds, 1),
            cell(100.0 * float(row.valid), 0), cell(known["estimate"], 2), cell(known["reference"], 2),
            Cell("; ".join(line for flag in _noted(str(row.notes)) for line in flag.text.splitlines())),
        ])  # fmt: skip
    left = len(cohort.recordings) - len(rows)
    text = f"The first {len(rows)}; {left} more are in the tables of jgait evaluate." if left else ""
    columns = ("recording", "person", "duration [s]", "results for [%]", "distance [m]", "reference [m]", "notes")
    caption = "All recordings that were used. A click on a heading sorts."
    return Section("Recordings", text, [Table(caption, columns, rows, True, 1)])


def _failures(failures: Sequence[tuple[str, str]]) -> Section | None:
    if not failures:
        return None
    rows = [[Cell(name), Cell(reason)] for name, reason in failures]
    table = Table("Recordings that could not be used, and why.", ("recording", "reason"), rows, words=1)
    return Section("What could not be used", "", [table])


def _parameters(made: Made) -> Section | None:
    table = made.table()
    if table is None:
        return None
    text = "Measures of a person that the cohort states replace these values, person by person."
    return Section("Parameters", text, [table])
