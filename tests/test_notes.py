"""Notes: every kind of the library is complete and used, and no code reads facts out of sentences."""

import ast
import collections
import functools
import json
import math
import re
import string
from pathlib import Path

import numpy as np
import pytest
from made.notes import kinds

import jgait
from jgait.commands import cohort_table
from jgait.estimators.notes import STRIDES_UNCERTAIN
from jgait.io.checks.readings import MASKED
from jgait.notes import (
    DATA_LOST,
    SEVERITIES,
    Kind,
    Note,
    from_json,
    grouped,
    listed,
    of_recordings,
    resolved,
    to_json,
    without_repeats,
)

ROOT = Path(jgait.__file__).parent
KINDS = kinds()
LOST = Kind("samples_lost", "check", "{placement}: {lost} of {share:.1f} % are lost in {files}", "Data are lost.")


def fields(kind: Kind) -> set[str]:
    """Names of the values in a kind's sentence."""
    return {name for _, name, _, _ in string.Formatter().parse(kind.text) if name}


@functools.cache
def keywords_of() -> dict[str, list[set[str] | None]]:
    """Name of a function → keywords (None where a mapping is unpacked) of each of its calls in the library."""
    found = collections.defaultdict(list)
    for path in ROOT.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
                name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
                keywords = {keyword.arg for keyword in node.keywords}
                found[name].append(None if None in keywords else keywords)
    return found


def test_codes_are_unique_and_snake_case():
    codes = [kind.code for kind in KINDS.values()]
    assert len(codes) > 80
    assert sorted(code for code in set(codes) if codes.count(code) > 1) == []
    assert [code for code in codes if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", code)] == []


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_is_complete_and_is_called_with_its_values(name):
    kind = KINDS[name]
    assert kind.severity in SEVERITIES
    assert re.match(r"[A-Z].*\.$", kind.meaning), kind.meaning
    own = name.rpartition(".")[2]
    if not kind.text:
        return  # its notes have sentences of their own
    given = keywords_of().get(own)
    assert given, f"{own} is never called"
    for keywords in given:
        assert keywords is None or keywords == fields(kind)


def test_a_note_is_its_sentence_and_its_values():
    note = LOST(placement="waist", lost=np.int64(3), share=np.float64(1.25), files=["a.csv", "b.csv"])
    assert str(note) == note.text == "waist: 3 of 1.2 % are lost in a.csv, b.csv"
    assert (note.code, note.severity) == ("samples_lost", "check")
    assert note.values == {"placement": "waist", "lost": 3, "share": 1.25, "files": ("a.csv", "b.csv")}
    assert len({note, LOST(placement="waist", lost=3, share=1.25, files=("a.csv", "b.csv"))}) == 1


def test_notes_of_one_kind_may_have_sentences_of_their_own():
    kind = Kind("data_lost", "check", "", "Data are lost.")
    plain, ours = kind.note("rows of {1}: 3"), kind.note("rows of {1}: 3", placement="waist")
    assert (plain.code, plain.text, plain.values) == ("data_lost", "rows of {1}: 3", {})
    assert (ours.text, ours.values) == ("waist: rows of {1}: 3", {"placement": "waist"})
    assert kind.note("{rows} {rows:row is|rows are} cut", rows=1).text == "1 row is cut"
    other = kind.note("rows of {1}: 3", placement="pelvis")
    assert [str(note) for note in grouped([ours, plain, other])] == ["waist, pelvis: rows of {1}: 3", "rows of {1}: 3"]


def test_a_number_chooses_the_singular_or_the_plural():
    kind = Kind(
        "gaps", "check", "{gaps} {gaps:gap is|gaps are} filled, the longest {longest_s:.1f} s", "Data are lost."
    )
    assert kind(gaps=1, longest_s=1.0).text == "1 gap is filled, the longest 1.0 s"
    assert kind(gaps=np.int64(2), longest_s=1).text == "2 gaps are filled, the longest 1.0 s"


def test_notes_that_state_the_same_of_several_sensors_are_one_for_people():
    same = [LOST(placement=name, lost=3, share=0.5, files="a.csv") for name in ("waist", "foot_left")]
    other = LOST(placement="foot_right", lost=3, share=0.5, files="b.csv")
    subject = Kind("still", "check", "{placement} never stands still", "It moves.")
    stands = [subject(placement=name) for name in ("waist", "foot_left")]
    assert [note.text for note in grouped([same[0], other, same[1], *stands])] == [
        "waist, foot_left: 3 of 0.5 % are lost in a.csv", str(other), *map(str, stands)
    ]  # fmt: skip


def test_notes_that_differ_in_numbers_become_one_with_their_range():
    lost = Kind(
        "rows_lost", "check", "{placement}: {lost} {lost:row|rows} of {of}, {share:.1f} %, {lost:is|are} lost", "…"
    )
    three = [
        lost(placement=name, lost=n, of=90, share=n / 0.9) for name, n in (("waist", 4), ("foot", 1), ("shank", 2))
    ]
    assert [note.text for note in grouped(three)] == ["waist, foot, shank: 1 to 4 rows of 90, 1.1 to 4.4 %, are lost"]
    again = lost(placement="waist", lost=7, of=90, share=7.8)  # of one sensor two: nothing is hidden in a range
    assert [note.text.split(":")[0] for note in grouped([*three, again])] == ["waist", "foot", "shank", "waist"]


def test_notes_come_back_from_json():
    note = LOST(placement="a {strange} name", lost=3, share=0.5, files=["a.csv"])
    content = json.loads(json.dumps(note.to_dict()))
    assert set(content) == {"code", "severity", "values", "text", "meaning", "measure"}
    back = Note.from_dict(content)
    assert back.to_dict() == note.to_dict() and back.text == note.text and back.values == note.values
    assert [each.to_dict() for each in from_json(to_json([note, note]))] == [note.to_dict()] * 2
    assert from_json("[]") == ()


@pytest.mark.parametrize("text", ["waist does not walk", "", '["a"]', '[{"code": "a"}]', "3"])
def test_other_texts_are_no_notes(text):
    with pytest.raises(ValueError, match=r"no notes in JSON|Expecting value"):
        from_json(text)


def test_a_value_that_the_sentence_needs_is_missed():
    with pytest.raises(KeyError, match="lost"):
        str(LOST(placement="waist"))


def test_no_code_reads_facts_out_of_sentences():
    searches = re.compile(r"re\.\w+\([^\n]*\b(?:notes?|reason|message|str\(error\))\b")
    rewrites = re.compile(
        r"str\((?:error|note)\)\.(?:replace|removeprefix|split|partition)|in (?:str\(note\)|note\.text)\b"
    )
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in sorted(ROOT.rglob("*.py"))
        for line in path.read_text(encoding="utf-8").splitlines()
        if searches.search(line) or rewrites.search(line)
    ]
    assert found == []


@pytest.mark.parametrize(
    ("many", "whole", "words"),
    [(1, 1, "1 of 1 recording is"), (1, 3, "1 of 3 recordings is"), (2, 3, "2 of 3 recordings are")],
)
def test_recordings_are_counted_in_the_singular_and_the_plural(many, whole, words):
    assert of_recordings(many, whole, "is", "are") == words
    note = cohort_table.MEASURE_OF_SOME(without=many, recordings=whole, column="height_m")
    assert str(note).startswith(words.replace("is", "has").replace("are", "have"))


def test_of_several_texts_two_are_shown():
    assert listed(["a"]) == "a" and listed("ab") == "a; b" and listed("abcd") == "a; b; and 2 more"
    assert listed(["a" * 300, "b" * 300]) == "a" * 300 + "; " + "b" * 300  # sentences are not cut


@pytest.mark.parametrize(
    "value, spread, text",
    [
        (1.003, 0.0016, "1.0030"),
        (0.99983, 0.0063, "0.9998"),
        (1.0061, 0.0063, "1.0061"),
        (0.43, 0.1, "0.43"),
        (-12.3456, 3.0, "−12.3"),
        (5.0, math.nan, "5"),
        (0.0, 0.1, "0"),
        (math.nan, 0.1, "–"),
        (2.5e-9, 1e-12, "2.5000e−09"),
    ],
)
def test_a_number_has_the_digits_that_its_spread_needs(value, spread, text):
    assert resolved(value, spread) == text


def test_lost_samples_that_the_reader_noted_are_not_counted_again():
    lost, other = (STRIDES_UNCERTAIN(samples=3, placement=f"foot_{side}", longest_s=0.03) for side in ("left", "right"))
    masked = MASKED.note("values that no sensor reads: 3", placement="foot_left")
    filled = DATA_LOST._replace(of_all=True).note("1 gap in time, the longest 1 s; 3 samples inserted and masked")
    assert without_repeats((lost, other)) == (lost, other)
    assert without_repeats((masked, lost, other, other)) == (masked, other)
    assert without_repeats((lost, other, filled)) == (filled,)
