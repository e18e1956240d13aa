"""The table of all experiments: as versioned in both places, complete, and made of full runs only."""

import json
import math
import shutil

import pytest


@pytest.fixture(scope="module")
def summary(load_experiment):
    return load_experiment("_summary")


@pytest.fixture
def copied(summary, tmp_path, monkeypatch):
    """The files that the command reads and writes, where it does no harm."""
    for name in ("NUMBERS", "SUMMARY", "README"):
        copy = tmp_path / name
        shutil.copy(getattr(summary, name), copy)
        monkeypatch.setattr(summary, name, copy)
    monkeypatch.setattr(summary, "HERE", tmp_path / "here")
    (tmp_path / "here").mkdir()
    for name in summary.wanted():
        (tmp_path / "here" / f"{name}.py").write_text(f'"""What {name} is for."""\n')
    return tmp_path


def run_of(name, metrics, quick=False, n=3):
    rows = [{"metric": m, "value": v, "unit": "", "paper": None, "n": n, "split": ""} for m, v in metrics.items()]
    return json.dumps({"experiment": name, "version": "9.9.9", "quick": quick, "rows": rows})


# --- what is versioned ---


def test_both_tables_are_what_the_versioned_numbers_give(summary):
    assert summary.stale(summary.load()) == [], "make summary writes them"
    table = summary.table(summary.load())
    for path in (summary.SUMMARY, summary.README):
        assert path.read_text(encoding="utf-8").count(table) == 1


def test_every_experiment_is_in_the_table_and_every_line_has_one(summary):
    assert set(summary.wanted()) == set(summary.experiments())
    assert "leg_ekf" in summary.experiments()
    assert all(f"- `{name}.py`: " in summary.page(summary.load()) for name in summary.experiments())


def test_the_versioned_numbers_are_those_of_the_table_and_no_others(summary):
    known = summary.load()
    assert {name: set(one["metrics"]) for name, one in known.items()} == summary.wanted()
    for name, one in known.items():
        assert one["version"], name
        for metric, row in one["metrics"].items():
            assert math.isfinite(row["value"]), f"{name}.{metric}"
            assert row["n"] >= 1, f"{name}.{metric}"
            assert summary.rounded(row["value"]) == row["value"], f"{name}.{metric}"


def test_every_line_shows_a_number_of_ours(summary):
    for line in summary.LINES:
        ours = [summary.metrics(line._replace(paper="", n="", **{other: ""})) for other in ("real", "simulated")]
        assert any(ours), line.label
        shown = summary.cells(line, summary.load())
        assert len(shown) == len(summary.HEAD)
        assert not any("{" in cell or "nan" in cell or "|" in cell or not cell for cell in shown), line.label


def test_a_number_that_changed_makes_both_tables_stale(summary):
    known = summary.load()
    known["leg_ekf"]["metrics"]["heldout_distance_error_pct"]["value"] += 1.0
    assert summary.stale(known) == ["experiments/README.md", "README.md"]


# --- cells ---


def test_numbers_are_spelled_as_in_text(summary):
    cell = summary.Cell(-0.01234, summary.Count(10000), 0.3)
    assert f"{cell:.2f}" == "−0.01"
    assert f"{cell.n:,} {cell.n}" == "10 000 10000"
    assert (f"{cell.cm:.1f}", f"{cell.pct:.1f}", f"{cell.ms:.1f}") == ("−1.2", "−1.2", "−12.3")
    assert (f"{cell.paper:g}", f"{cell.paper.ms:.0f}") == ("0.3", "300")


def line_of(summary, **cells):
    return summary.Line("what", "made", **{"n": "1 walk"} | cells)


KNOWN = {
    "made": {
        "version": "1",
        "metrics": {
            "a": {"value": 1.0, "n": 2, "paper": None},
            "b": {"value": 3.0, "n": 5, "paper": 4.0},
        },
    }
}


def test_cells_choose_among_metrics(summary):
    line = line_of(summary, simulated="{least[a,b]:.0f} to {most[a,b]:.0f}", real="{b.paper:g}", n="{total[a,b]}")
    assert summary.cells(line, KNOWN) == ["what", "–", "1 to 3", "4", "7", "`experiments/made.py`"]
    assert summary.metrics(line) == {"a", "b"}


@pytest.mark.parametrize(
    "cell, said",
    [("{c:.1f}", "'c'"), ("{least[a,c]:.1f}", "'c'"), ("{a.paper:g}", "gives no figure"), ("{a.km}", "km")],
)
def test_a_cell_that_cannot_be_filled_is_named(summary, cell, said):
    with pytest.raises(ValueError, match="made, 'what'") as raised:
        summary.cells(line_of(summary, real=cell), KNOWN)
    assert said in str(raised.value)


# --- the command ---


def test_full_runs_replace_numbers_and_others_leave_them(summary, tmp_path):
    known = summary.load()
    (tmp_path / "cohort.json").write_text(
        run_of("cohort", {"distance_error_median_pct": 0.123456789, "distance_error_worst_pct": 2.0, "other": 1.0})
    )
    (tmp_path / "leg_ekf.json").write_text(run_of("leg_ekf", {"heldout_distance_error_pct": 99.0}, quick=True))
    partly = {"energy_column_max_error": 0.5, "tripod_err_duty40": math.nan}
    (tmp_path / "duty_cycled_gyro.json").write_text(run_of("duty_cycled_gyro", partly))
    new, remarks = summary.refreshed(known, tmp_path)
    assert new["cohort"] == {
        "version": "9.9.9",
        "metrics": {
            "distance_error_median_pct": {"value": 0.123457, "n": 3, "paper": None},
            "distance_error_worst_pct": {"value": 2.0, "n": 3, "paper": None},
        },
    }
    assert new["leg_ekf"] == known["leg_ekf"]
    assert new["tuning"] == known["tuning"]
    duty = new["duty_cycled_gyro"]["metrics"]
    assert duty["energy_column_max_error"]["value"] == 0.5
    assert duty["tripod_err_duty40"] == known["duty_cycled_gyro"]["metrics"]["tripod_err_duty40"]
    said = "\n".join(remarks)
    assert "leg_ekf: as before" in said and "is a quick run" in said
    assert "tuning: as before" in said and "is not there" in said
    assert "duty_cycled_gyro: as before, for the run has none of them: " in said and "tripod_err_duty40" in said
    assert "cohort" not in said


def test_the_command_writes_both_tables_and_says_when_they_are_old(summary, copied, capsys):
    results = copied / "results"
    results.mkdir()
    (results / "cohort.json").write_text(
        run_of("cohort", {"distance_error_median_pct": 0.5, "distance_error_worst_pct": 77.7}, n=1234)
    )
    assert summary.main(["--results", str(results)]) == 0
    for path in (summary.README, summary.SUMMARY):
        assert "| 0.50 (77.7) | – | 1 234 people |" in path.read_text(encoding="utf-8")
    assert "jgait 0.1.0, 9.9.9" in summary.SUMMARY.read_text(encoding="utf-8")
    first = [path.read_bytes() for path in (summary.NUMBERS, summary.SUMMARY, summary.README)]
    assert summary.main(["--results", str(copied / "empty")]) == 0
    assert [path.read_bytes() for path in (summary.NUMBERS, summary.SUMMARY, summary.README)] == first
    assert summary.main(["--check"]) == 0
    summary.SUMMARY.write_text(summary.SUMMARY.read_text(encoding="utf-8").replace("77.7", "0.1"), encoding="utf-8")
    capsys.readouterr()
    assert summary.main(["--check"]) == 1
    assert capsys.readouterr().out.startswith("out of date: SUMMARY;")


def test_nothing_is_written_where_a_number_or_a_mark_is_missing(summary, copied, capsys):
    before, readme = summary.SUMMARY.read_bytes(), summary.README.read_text(encoding="utf-8")
    summary.README.write_text(readme.replace(summary.BEGIN, ""), encoding="utf-8")
    assert summary.main(["--results", str(copied)]) == 1
    assert "README.md has no <!-- table" in capsys.readouterr().err
    summary.README.write_text(readme, encoding="utf-8")
    summary.NUMBERS.unlink()
    assert summary.main(["--results", str(copied)]) == 1
    assert "leg_ekf, \"paper's pipeline, straight" in capsys.readouterr().err
    assert summary.SUMMARY.read_bytes() == before
    assert not summary.NUMBERS.exists()
