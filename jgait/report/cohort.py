"""The page of a cohort."""

import json
import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import PyTree

from jgait import estimators
from jgait.estimators import about_of
from jgait.estimators.stride_flags import STRIDE_COLUMNS
from jgait.evaluate import Cohort
from jgait.evaluate.store import REGULAR, read_table
from jgait.io import flags
from jgait.io.flags import Flag, without_folders
from jgait.io.write import from_cells
from jgait.notes import SEVERITIES, Note, from_json, grouped, listed, of_recordings, resolved
from jgait.plot import cohort as plot_cohort
from jgait.report.made import Made
from jgait.report.page import Cell, Picture, Report, Section, Table, cell, number, picture, significant
from jgait.report.recording import readable

if TYPE_CHECKING:
    import pandas as pd

DRAWN = ("distance_m", "stride_length_m", "stride_width_m", "walking_speed_mps", "stride_duration_s")
"""Quantities with figures, where two people or more have them."""

FEWEST_PEOPLE = 5
"""[1] Least number of people for limits of agreement and ICC: t of the limits' interval is 12.7 with 2, 2.8 with 5."""

WITHIN = "_within_2sd_percent"
"""End of the name of a quantity that states how many errors the stated deviations contain."""


def of_cohort(cohort: Cohort, *, title: str = "cohort", made: Made | None = None) -> Report:
    """The page of a cohort, of `jgait.evaluate.cohort`: agreement with the reference, Bland–Altman, people, recordings,
    and failures; `made` states how the results were made.

    Raises:
        ValueError: if the cohort has no recording, neither used nor failed.
        ImportError: without the extra `cli`.
    """
    made = Made() if made is None else made
    failures = {without_folders(str(row.recording)): without_folders(str(row.reason))
                for row in cohort.failures.itertuples()}  # fmt: skip
    if not len(cohort.recordings) and not failures:
        raise ValueError("a report needs recordings; the cohort has none, not even one that failed")
    usable = cohort.usable()
    paired, agreement = usable.paired(), usable.agreement()
    raised = flags.ordered([*flags.explained(made.notes), *doubts(cohort, usable)])
    used, people = len(cohort.recordings), cohort.recordings["subject"].nunique()
    facts = [
        ("Recordings used", f"{used} of {used + len(cohort.failures)}", f"of {people} people"),
        ("Recorded time", f"{number(float(cohort.recordings['seconds'].sum()), 0)} s", "of the recordings used"),
        *_headline(paired, agreement),
    ]  # fmt: skip
    about = about_of(made.estimator)
    tuned = [f"{note.text[:1].upper()}{note.text[1:]}." for note in made.notes if note.code.endswith("held_out")]
    known = " ".join([*tuned, *remarks(usable, agreement, "stride_time" in (about.losses or ()))])
    lost = Table("Recordings that could not be used, and why.", ("recording", "reason"),
                 [[Cell(name), Cell(reason)] for name, reason in failures.items()], words=1)  # fmt: skip
    how = (
        "Difference between estimate and reference against the mean of both; of strides, all are drawn. The full line "
        "is the bias; between the dashed lines 95 of 100 differences are expected. Bars beside the axes are 95 % "
        "intervals."
    )
    body = "Measures of a person that the cohort states replace these values, person by person."
    sections = [
        Section("Bland–Altman", how, _figures(paired)),
        Section("Agreement with the reference", known, agreement_tables(agreement)),
        _people(cohort, usable), _recordings(cohort),
        Section("What could not be used", "", [lost] if failures else []),
        Section("Parameters", body, [table for table in [made.table()] if table is not None]),
    ]  # fmt: skip
    lead = "compared with an independent measurement" if len(paired) else "no reference is known"
    numbers = {
        "kind": "cohort", "cohort": title, "recordings": used, "people": people, "failures": failures,
        "agreement": agreement.astype(object).to_dict("index"), "flags": [flag._asdict() for flag in raised],
        "people_table": usable.by_subject().to_dict("records"), "made": made.numbers(),
    }  # fmt: skip
    return Report(
        Path(title).name, "Cohort report", f"{about.title}{',' if len(paired) else ';'} {lead}.", facts,
        flags.verdict(raised), raised, "Errors: estimate − reference.",
        [section for section in sections if section.parts], made.settings(), made.command, numbers,
    )  # fmt: skip


def doubts(cohort: Cohort, usable: Cohort) -> list[Flag]:
    """What puts the numbers of a cohort in doubt, the most serious first: for the page and the terminal."""
    return flags.ordered([*_of_numbers(cohort, usable), *of_notes(cohort.recordings)])


def _of_numbers(cohort: Cohort, usable: Cohort) -> Iterator[Flag]:
    """Recordings that are in no number, a missing reference, few people."""
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
    paired = usable.paired()
    compared = paired.loc[paired["estimate"].notna()]
    without, people = kept - compared["recording"].nunique(), compared["subject"].nunique()
    if kept and without == kept:
        meaning = "This cohort cannot show how well the numbers agree with the truth."
        yield Flag("check", "No recording has a reference", meaning)
    elif without:
        meaning = "They are in the table of recordings and in none of the comparisons."
        yield Flag("info", f"{of_recordings(without, kept, 'has', 'have')} no reference", meaning)
    if 0 < people < 10:
        meaning = "Limits of agreement of few people are uncertain themselves; their intervals are drawn beside them."
        if people < FEWEST_PEOPLE:
            meaning = f"Limits of agreement and ICC need {FEWEST_PEOPLE} people."
        yield Flag("check", f"Only {people} {'person' if people == 1 else 'people'} compared", meaning)


def of_notes(recordings: "pd.DataFrame") -> list[Flag]:
    """The notes that put recordings in doubt, by meaning: how many recordings, and an example; those that all errors
    depend on first, those that most cohorts have last.
    """
    kinds: dict[tuple[str, str], dict[str, list[Note]]] = {}
    for name, text in zip(recordings["recording"], recordings["notes"], strict=True):
        for note in _doubtful(str(text)):
            kinds.setdefault((note.severity, note.meaning), {}).setdefault(str(name), []).append(note)

    def rank(kind: tuple[str, str]) -> tuple[int, bool, bool, int]:
        code = next(iter(kinds[kind].values()))[0].code
        return SEVERITIES.index(kind[0]), not code.startswith("reference_"), kind[1] in flags.USUAL, -len(kinds[kind])

    note_flags = []
    for severity, meaning in sorted(kinds, key=rank):
        name, same = next(iter(kinds[severity, meaning].items()))
        sentences = listed(map(flags.sentence, same))
        many = of_recordings(len(kinds[severity, meaning]), len(recordings))
        usable = "" if severity == "check" else ", whose result should not be used"
        note_flags.append(Flag("check", f"{many}{usable}, such as {without_folders(name)}: {sentences}", meaning))
    return note_flags


def _doubtful(text: str) -> list[Note]:
    """The notes of a recording, as JSON, that put it in doubt."""
    return [note for note in grouped(from_json(text)) if note.severity in flags.DOUBTS]


def _headline(paired: "pd.DataFrame", agreement: "pd.DataFrame") -> list[tuple[str, str, str]]:
    """Bias and limits of the distance and of the length of regular strides, and the distance's relative error."""
    facts = []
    regular = REGULAR + DRAWN[1]
    for name in (DRAWN[0], regular if regular in agreement.index else DRAWN[1]):
        if name in agreement.index and np.isfinite(agreement.loc[name, ["bias", "loa_low"]].to_numpy(float)).all():
            words, unit = readable(name)
            row = agreement.loc[name]
            limits = f"95 % limits of agreement {_span(row['loa_low'], row['loa_high'])} {unit}"
            limits = limits if row["n_subjects"] >= FEWEST_PEOPLE else "too few people for limits of agreement"
            facts.append((f"{words.capitalize()}: bias", f"{significant(row['bias'])} {unit}", limits))
    relative = paired.loc[paired["quantity"] == "distance_m", "rel_error"].abs().dropna()
    if len(relative):
        facts.append(("Distance: mean |error|", f"{number(100.0 * float(relative.mean()), 1)} %", "of the reference"))
    return facts


def agreement_tables(agreement: "pd.DataFrame") -> list[Table]:
    """Bias, limits and ICC of every quantity, and errors of whole curves: for the page and the terminal."""
    rows, curves = [], []
    for name, row in agreement[agreement["n"] > 0].iterrows():
        words, unit = readable(str(name))
        cells = [Cell(f"{words} [{unit}]" if unit else words),
                 Cell(f"{row['n']:.0f} / {row['n_subjects']:.0f}", float(row["n"]))]  # fmt: skip
        if "_rmse_" in str(name):
            curves.append([*cells, *(Cell(significant(row[c]), float(row[c])) for c in ("bias", "max_abs"))])
            continue
        limits, icc = Cell(_span(row["loa_low"], row["loa_high"]), row["loa_high"]), _interval(row, "icc")
        if row["n_subjects"] < FEWEST_PEOPLE:
            limits = icc = Cell("too few people", math.nan)
        worst = Cell(significant(row["max_abs"]), float(row["max_abs"]))
        rows.append([*cells, _interval(row, "bias"), limits, _interval(row, "mae"), worst, icc])
    tables = []
    if rows:
        caption = (
            "Estimate − reference, each quantity in its own unit; in brackets 95 % intervals, over people. ICC(2,1) "
            "compares with how much the people differ: 1 is perfect, and – where the reference does not vary. Limits "
            f"and ICC need {FEWEST_PEOPLE} people. Regular "
            "strides are in no turn, on no stairs, no half-step and not uneven; those of lengths and speeds are not in "
            "doubt either. Half-steps from and to standing make the ICC of all strides' lengths larger."
        )
        columns = ("quantity", "n / people", "bias", "95 % limits", "mean |error|", "worst |error|", "ICC(2,1)")
        tables.append(Table(caption, columns, rows))
    if curves:
        caption = (
            "Root mean square difference of whole curves, over recordings: of angles with the offsets while standing, "
            "of feet after they are turned and shifted to fit."
        )
        tables.append(Table(caption, ("curve", "n / people", "mean", "worst"), curves))
    return tables


def remarks(usable: Cohort, agreement: "pd.DataFrame", has_strides: bool) -> list[str]:
    """Sentences about the agreement; `has_strides` tells whether the estimator has strides, or only a distance."""
    lines, rows = [], usable.paired()
    lacking: dict[str, list[str]] = {}
    for name in agreement.index.intersection(list(STRIDE_COLUMNS)):
        n, dropped = agreement.loc[name, ["n", "n_dropped"]]
        if n and dropped:
            lacking.setdefault(f"{dropped:.0f} of {n + dropped:.0f}", []).append(readable(name)[0])
    why = "the body's way, which is estimated, differs from the foot's from and to standing and in turns"
    if has_strides:
        why = "no estimated stride fits their times: the estimate lacks them, or the reference is of other times"
    for lacks, what in lacking.items():
        lines.append(f"{', '.join(what).capitalize()}: {lacks} strides of the reference are not compared; {why}.")
    for name in (name for name in agreement.index[agreement["n"] > 0] if name.endswith(WITHIN)):
        share = rows.loc[rows["quantity"] == name, "estimate"].dropna()
        what = name.removesuffix(WITHIN).replace("_", " ").capitalize()
        lines.append(
            f"{what}: {share.mean():.1f} % of a recording's strides within two stated standard deviations, lowest "
            f"{share.min():.1f} % (95.4 % are to be expected)."
        )
    relative = 100.0 * rows.loc[rows["quantity"] == "distance_m", "rel_error"].abs().dropna()
    if len(relative):
        lines.append(
            f"Distance: |error| {relative.mean():.1f} % on average, median {relative.median():.1f} %, worst "
            f"{relative.max():.1f} %."
        )
    return lines


def _span(low: float, high: float) -> str:
    return "–" if not np.isfinite([low, high]).all() else f"{resolved(low, high - low)} to {resolved(high, high - low)}"


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
        figure, each = (draw(rows, words, unit=unit) for draw in (plot_cohort.bland_altman, plot_cohort.per_subject))
        made.append(picture(figure, alt, f"Bland–Altman plot of {words}."))
        caption = f"Absolute errors of {words} by person, the best on top."
        made.append(picture(each, f"Absolute errors of {words} of each person", caption))
    return made


def _people(cohort: Cohort, usable: Cohort) -> Section:
    """One row for each person: recordings used and failed, and mean errors."""
    lost = Counter(map(str, cohort.failures["subject"].fillna("")))
    used = cohort.recordings.groupby("subject")["recording"].count()
    errors = usable.by_subject().dropna(subset="error").pivot(index="subject", columns="quantity")
    shown = ("distance_m", "stride_length_m", "walking_speed_mps", "stride_width_m")
    quantities, rows = [name for name in shown if ("error", name) in errors], []
    for subject in sorted({*map(str, used.index), *(name for name in lost if name)}):
        means = errors.loc[subject] if subject in errors.index else {}
        each = [means.get((kind, name)) for name in quantities for kind in ("error", "abs_error")]
        counts = (cell(float(count), 0) for count in (used.get(subject, 0), lost.get(subject, 0)))
        rows.append([Cell(subject), *counts, *(cell(mean, 3) for mean in each)])
    heads = []
    for name in quantities:
        words, unit = readable(name)
        heads += [f"{words}: mean error [{unit}]", f"mean |error| [{unit}]"]
    caption = "Estimate − reference, mean over each person's recordings or strides. A click on a heading sorts."
    failed = of_recordings(lost[""], sum(lost.values()), "that failed is", "that failed are")
    text = f"{failed} of nobody who is known." if lost[""] else ""
    return Section("People", text, [Table(caption, ("person", "used", "failed", *heads), rows, True)])


def _recordings(cohort: Cohort) -> Section:
    """One row for each recording: its length, the share with results, its notes."""
    way = cohort.quantities[cohort.quantities["quantity"] == "distance_m"].set_index("recording")
    rows = []
    for row in cohort.recordings.head(2000).itertuples():
        known = way.loc[row.recording] if row.recording in way.index else {"estimate": None, "reference": None}
        rows.append([
            Cell(without_folders(str(row.recording))), Cell(str(row.subject)), cell(row.seconds, 1),
            cell(100.0 * float(row.valid), 0), cell(known["estimate"], 2), cell(known["reference"], 2),
            Cell("; ".join(map(flags.sentence, _doubtful(str(row.notes))))),
        ])  # fmt: skip
    left = len(cohort.recordings) - len(rows)
    text = f"The first {len(rows)}; {left} more are in the tables of jgait evaluate." if left else ""
    columns = ("recording", "person", "duration [s]", "results for [%]", "distance [m]", "reference [m]", "notes")
    caption = "All recordings that were used. A click on a heading sorts."
    return Section("Recordings", text, [Table(caption, columns, rows, True, 1)])


def read_folder(folder: Path) -> tuple[Cohort, Made]:
    """The tables of an evaluation that `jgait evaluate` wrote, and its settings.

    Raises:
        FileNotFoundError: if a table or the settings are missing.
        ValueError: if a table lacks a column, or has text instead of numbers, or the settings state no estimator.
    """
    cohort = Cohort(*(from_cells(read_table(folder / f"{name}.csv", name)) for name in Cohort._fields))
    for text in cohort.recordings["notes"]:
        from_json(text)
    about = json.loads((folder / "run" / "cohort.json").read_text(encoding="utf-8"))
    if not isinstance(about, dict) or "estimator" not in about:
        raise ValueError("run/cohort.json does not state how the evaluation was made")
    name, stored = str(about["estimator"]), json.loads(about["params"])
    default = estimators.get(name).params if name in estimators.names() else None
    numbers = stored if isinstance(stored, dict) else {}
    values = {name_of: value for name_of, value in numbers.items() if isinstance(value, float)}
    params = jax.tree_util.tree_map_with_path(
        lambda where, old: values.get(jax.tree_util.keystr(where).lstrip("."), old), default
    )
    stated = folder / "notes.json"
    every = json.loads(stated.read_text(encoding="utf-8")) if stated.is_file() else []
    notes = from_json(json.dumps([note for note in every if note.get("recording") is None]))  # others: in the table
    version = str(about.get("jgait", ""))
    return cohort, Made(name, params, default, file=folder.resolve().name, notes=notes, version=version)
