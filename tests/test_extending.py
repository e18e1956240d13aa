"""A new estimator, data set, file format, figure or command touches few places, and all of jgait knows it then."""

import json
import os
import subprocess
import sys
from pathlib import Path

import layering
import numpy as np
import pytest
from extending import TOYS, extended

ROOT = Path(__file__).parents[1]
MOST = {"estimator": 4, "dataset": 3, "format": 2, "figure": 3, "command": 3}

CHAIN = """
import json, sys
from pathlib import Path
from typer.testing import CliRunner
import jgait
from jgait import cli

def jg(*words):
    done = CliRunner().invoke(cli.app, [str(word) for word in words])
    assert done.exit_code == 0, (words, done.output, done.exception)
    return done.output

walk = "data/toy_walks/anna.toy"
said = {"home": str(Path(jgait.__file__).parents[1])}
jg("estimate", walk, "--estimator", "toy_speed", "--out", "estimated", "--json", "estimated.json")
jg("evaluate", "--dataset", "toy_walks", "--estimator", "toy_speed", "--out", "evaluated", "--json", "evaluated.json")
jg("report", walk, "--estimator", "toy_speed", "--out", "page.html")
said["hello"] = jg("toy-hello", "--name", "anna")
said["sets"] = jg("datasets", "list")
from experiments.__main__ import main
main(["toy_speed", "--quick", "--json", "rows.json"])
sys.path.insert(0, "docs/_ext")
import pages, sources
said["documents"] = [sources.methods(), sources.formats(), sources.command_line()]
said["api"] = [name for name in pages.modules() if "toy" in name]
Path("said.json").write_text(json.dumps(said))
"""


def test_a_new_part_touches_few_places():
    assert {toy.kind: len(toy.places) <= MOST[toy.kind] for toy in TOYS} == dict.fromkeys(MOST, True)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of the checkout with a toy of each kind, after the whole chain has run in it."""
    folder = tmp_path_factory.mktemp("extended")
    extended(ROOT, folder)
    data = folder / "data" / "toy_walks"
    data.mkdir(parents=True)
    rng = np.random.default_rng(0)
    for name in ("anna", "bert"):
        signals = 0.5 * rng.normal(size=(600, 6)) + [0.0, 0.0, 0.0, 0.0, 0.0, 9.81]
        lines = [" ".join(f"{value:.4f}" for value in row) for row in signals]
        (data / f"{name}.toy").write_text("\n".join(["toy 100", *lines]))
    environment = {**os.environ, "PYTHONPATH": str(folder), "JGAIT_DATA_DIR": str(folder / "data")}
    done = subprocess.run(
        [sys.executable, "-c", CHAIN], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_a_new_estimator_and_its_figure_are_in_estimates_cohorts_and_reports(checkout):
    said = json.loads((checkout / "said.json").read_text())
    assert Path(said["home"]) == checkout
    (numbers,) = json.loads((checkout / "estimated.json").read_text())["recordings"].values()
    assert numbers["files"]
    written = {path.name for path in (checkout / "estimated").iterdir()}
    assert {"anna_samples.csv", "anna_feet.png"} <= written
    evaluated = json.loads((checkout / "evaluated.json").read_text())
    assert evaluated["recordings"] == 2 and evaluated["failures"] == {}
    page = (checkout / "page.html").read_text(encoding="utf-8")
    assert "Distance at one speed" in page and "The distance in feet." in page
    (row,) = json.loads((checkout / "rows.json").read_text())["rows"]
    assert row["value"] == 1.2


def test_a_new_data_set_format_and_command_are_in_the_commands_and_the_documentation(checkout):
    said = json.loads((checkout / "said.json").read_text())
    assert "toy_walks" in said["sets"] and said["hello"] == "hello anna\n"
    methods, formats, helps = said["documents"]
    assert "[toy_speed](toy_speed.md)" in methods and "Toy text" in formats and "jgait toy-hello" in helps
    assert len(said["api"]) == 6


def test_new_parts_keep_the_order_of_imports(checkout):
    edges = layering.imports(checkout)
    assert layering.upward(edges) == []
    assert not any("toy" in box for ring in layering.circles(edges) for box in ring)
