"""The table of all experiments: what the versioned rows give, made of full runs only; and how experiments are named."""

import json
import math
import shutil

import pytest

from experiments import __main__ as runner
from experiments.common import row as common_row
from experiments.common import summary
from jgait import __version__


@pytest.fixture(scope="module")
def made():
    """A row of a table, as JSON holds it."""
    kind = common_row.Row

    def make(metric, value, line="distance: error", part="", **others):
        return kind(metric, value, "%", **others).on(line, part, "people")._asdict()

    return make


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """The files that the command reads and writes, where it does no harm."""
    for name in ("NUMBERS", "PAGE", "README"):
        copy = tmp_path / name
        shutil.copy(getattr(summary, name), copy)
        monkeypatch.setattr(summary, name, copy)
    return tmp_path


def run_of(name, rows, quick=False):
    return json.dumps({"experiment": name, "version": "9.9.9", "quick": quick, "rows": rows})


# --- what is versioned ---


def test_the_tables_are_what_the_versioned_rows_give():
    for path, text in summary.texts(summary.load()).items():
        assert path.read_text(encoding="utf-8") == text, "make summary writes it"


def test_every_versioned_row_has_a_line_a_number_and_a_count():
    known = summary.load()
    assert set(known) <= set(summary.EXPERIMENTS)
    assert len(known) > 8
    for name, one in known.items():
        assert one["version"], name
        metrics = [row["metric"] for row in one["rows"]]
        assert len(metrics) == len(set(metrics)), name
        for row in one["rows"]:
            assert row["line"] and row["of"] and row["n"] >= 1, row
            assert math.isfinite(row["value"]) and summary.rounded(row) == row, row
            assert "|" not in row["line"] + row["part"], row


def test_the_table_of_the_readme_has_six_rows_of_recordings():
    metrics = {row["metric"]: row["data"] for one in summary.load().values() for row in one["rows"]}
    assert len(summary.HEADLINES) == 6
    for one in summary.HEADLINES:
        named = [*one.errors.values(), *one.guess.values(), *filter(None, [one.worst])]
        assert {metrics[name] for name in named} == {"recordings"}, one.quantity


# --- lines ---


def test_rows_of_one_line_stand_together(made):
    kind = common_row.Row
    rows = [kind(**row) for row in (made("a", 1.0, part="mean", n=2, paper=4.0), made("b", 3.0, part="worst", n=2))]
    rows.append(kind("c", 2.0, "%", 4.0, 5).on("distance: error", of="walks", simulated=True))
    rows.append(kind("d", 0.5, "ratio").on("share", of="figures"))
    assert summary.lines("leg_ekf", rows) == [
        ["distance: error [%]", "4.00", "2.00", "mean 1.00; worst 3.00", "5 walks; 2 people", "`leg_ekf`"],
        ["share", "–", "–", "0.500", "1 figures", "`leg_ekf`"],
    ]


# --- the command ---


def test_full_runs_replace_rows_and_others_leave_them(made, tmp_path):
    known = {
        "cohort": {"version": "1", "rows": [made("a", 1.0), made("gone", 5.0)]},
        "tuning": {"version": "1", "rows": [made("b", 1.0)]},
        "leg_ekf": {"version": "1", "rows": [made("c", 1.0)]},
    }
    rows = [made("a", 0.123456789), made("new", math.nan), {**made("other", 1.0), "line": ""}]
    (tmp_path / "cohort.json").write_text(run_of("cohort", rows))
    (tmp_path / "leg_ekf.json").write_text(run_of("leg_ekf", [made("c", 99.0)], quick=True))
    new, remarks = summary.refreshed(known, tmp_path)
    assert new["cohort"] == {"version": "9.9.9", "rows": [made("a", 0.123457), made("gone", 5.0)]}
    assert new["leg_ekf"] == known["leg_ekf"] and new["tuning"] == known["tuning"]
    told = "\n".join(remarks)
    assert "leg_ekf: as before" in told and "is a quick run" in told
    assert "tuning: as before" in told and "is not there" in told
    assert "cohort: as before, for the run has none of them: gone" in told


def test_the_command_writes_the_tables_and_reports_old_ones(made, copied, capsys):
    results = copied / "results"
    results.mkdir()
    (results / "cohort.json").write_text(run_of("cohort", [made("distance_error_worst_pct", 77.7, n=1234)]))
    assert summary.main(["--results", str(results)]) == 0
    text = summary.PAGE.read_text(encoding="utf-8")
    assert "77.7 | 1 234 people |" in text and f"jgait {__version__}, 9.9.9" in text
    first = [path.read_bytes() for path in (summary.NUMBERS, summary.PAGE, summary.README)]
    assert summary.main(["--results", str(copied / "empty")]) == 0
    assert [path.read_bytes() for path in (summary.NUMBERS, summary.PAGE, summary.README)] == first
    assert summary.main(["--check"]) == 0
    summary.PAGE.write_text(text.replace("77.7", "0.1"), encoding="utf-8")
    capsys.readouterr()
    assert summary.main(["--check"]) == 1
    assert capsys.readouterr().out.startswith("out of date: PAGE;")
    summary.README.write_text("no marks", encoding="utf-8")
    assert summary.main(["--results", str(results)]) == 1
    assert "README.md has no <!-- table" in capsys.readouterr().err


# --- how experiments are named ---


def test_every_experiment_has_parts_that_make_rows(capsys):
    for name in runner.ALL:
        assert all(callable(part.rows) for part in runner.parts(name)), name
    (one,) = runner.parts("leg_ekf.table2")
    assert one.__name__ == "experiments.bennett2013.table2"
    with pytest.raises(ValueError, match="leg_ekf has no part 'table3'; it has table2"):
        runner.parts("leg_ekf.table3")
    runner.main(["--list", "experiments"])
    assert capsys.readouterr().out.split() == list(runner.EXPERIMENTS)
