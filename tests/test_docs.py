"""The documentation site: it builds without a warning, shows everything public, and asks nothing of a network."""

import ast
import importlib
import inspect
import re
import subprocess
import sys
from collections.abc import Callable
from html import unescape
from pathlib import Path
from types import ModuleType

import nbformat
import pytest

from jgait import estimators
from jgait.estimators.leg_ekf import params as leg_params

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "jgait"
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
SECTIONS = ("What it gives", "What it needs", "Equations", "Deviations from the paper", "Accuracy", "Reference")
PACKAGES = sorted({estimators.get(name).run.__module__.split(".")[2] for name in estimators.names()})
"""Each has a page; an estimator that is registered twice has one."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet",
         "--doctree-dir", str(folder / "doctrees"), "docs", str(folder / "html")],
        cwd=ROOT, capture_output=True, text=True, timeout=900, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "html"


@pytest.fixture
def extension(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], ModuleType]:
    """A module of docs/_ext by its name."""
    monkeypatch.syspath_prepend(ROOT / "docs" / "_ext")
    return importlib.import_module


def words(page: Path) -> str:
    """What a page says, without its marks, each space one."""
    article = re.search(r"<article.*?</article>", page.read_text(encoding="utf-8"), re.DOTALL)
    assert article is not None
    return " ".join(unescape(re.sub(r"<[^>]+>", "", article[0])).split())


# --- the site ---


@pytest.mark.release
def test_nothing_is_asked_of_a_network(site):
    asked = re.compile(r"<(?:script|link|img|iframe|source|video)\b[^>]*(?:src|href)=[\"']?(?:https?:)?//[^>]*>", re.I)
    pages = list(site.rglob("*.html"))
    assert len(pages) > 100
    assert [found for page in pages for found in asked.findall(page.read_text(encoding="utf-8"))] == []
    styles = "".join(sheet.read_text(encoding="utf-8") for sheet in site.rglob("*.css"))
    assert re.findall(r"@import[^;]*https?:|url\([\"']?(?:https?:)?//", styles) == []


@pytest.mark.release
def test_what_makes_the_site_is_not_part_of_it(site):
    assert not list(site.rglob("*.py"))
    assert not list(site.rglob("_ext"))
    written = [page.relative_to(ROOT / "docs").with_suffix(".html") for page in (ROOT / "docs").rglob("*.md")]
    assert len(written) > 10
    assert [str(page) for page in written if "{{ " in words(site / page)] == []


@pytest.mark.release
def test_every_public_function_and_class_has_its_place(site):
    there = set()
    for page in (site / "api").rglob("*.html"):
        there |= set(re.findall(r'id="(?:module-)?(jgait[\w.]*)"', page.read_text(encoding="utf-8")))
    wanted = set()
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(ROOT).with_suffix("").parts
        module = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        wanted.add(module)
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                wanted.add(f"{module}.{node.name}")
    assert len(wanted) > 1000
    commands = {f"jgait.commands.{path.stem}.{path.stem}" for path in (PACKAGE / "commands").glob("*.py")}
    assert sorted(wanted - there - commands) == [], "commands are on the page of the command line"


@pytest.mark.release
@pytest.mark.parametrize("name", PACKAGES)
def test_every_method_has_its_page(site, name):
    page = site / "methods" / f"{name}.html"
    text = page.read_text(encoding="utf-8")
    headings = re.findall(r"<h2[^>]*>(.*?)<a ", text)
    assert [heading for heading in SECTIONS if heading not in headings] == []
    assert text.count("<math ") > 5
    said = words(page)
    assert not re.search(r"\\[a-z]{2,}|\$\$", said), "a formula was left as it was written"
    rows = text[text.index('id="accuracy"') :].count("<tr ")
    assert rows >= 2, "a head and a row"


@pytest.mark.release
@pytest.mark.parametrize("name", PACKAGES)
def test_every_deviation_is_shown_with_its_number(site, name):
    package = importlib.import_module(f"jgait.estimators.{name}")
    docstring = inspect.getdoc(package)
    listed = docstring[docstring.index("Deviations") :]
    numbers = re.findall(r"^ {4}(\d+)\. ", listed, re.MULTILINE)
    text = (site / "methods" / f"{name}.html").read_text(encoding="utf-8")
    shown = re.search(r"<ol.*?</ol>", text[text.index('id="deviations-from-the-paper"') :], re.DOTALL)
    assert numbers
    assert shown
    start = re.match(r'<ol[^>]* start="(\d+)"', shown[0])
    assert numbers == [str(int(start[1] if start else 1) + k) for k in range(shown[0].count("<li>"))]


@pytest.mark.release
def test_every_row_of_the_experiments_is_shown(site):
    table = (ROOT / "experiments" / "README.md").read_text(encoding="utf-8")
    commands = re.findall(r"^\|.*\| `(\w+)` \|$", table, re.MULTILINE)
    assert len(commands) > 20
    rows = re.findall(r"<tr .*?</tr>", (site / "experiments.html").read_text(encoding="utf-8"), re.DOTALL)
    cells = [re.sub(r"<[^>]+>", "", row.rpartition("<td>")[2]).strip() for row in rows]
    assert [cell for cell in cells if cell in commands] == commands
    methods = "".join(page.read_text(encoding="utf-8") for page in (site / "methods").glob("*.html"))
    made = set(re.findall(r"Measured by the experiment <code[^>]*><span[^>]*>(\w+)</span></code>", methods))
    assert made == set(commands) - {"simulator"}


@pytest.mark.release
def test_the_page_of_the_command_line_is_its_help(site):
    said = words(site / "command-line.html")
    for name in ("demo", "estimate", "simulate", "evaluate", "tune", "report", "datasets list", "datasets fetch"):
        assert f"Usage: jgait {name} " in said
    assert "--thigh" in said


@pytest.mark.release
def test_every_format_that_is_read_is_listed(site):
    from jgait.io.formats import registry

    said = words(site / "formats.html")
    assert [one.title for one in registry.FORMATS.values() if one.title not in said] == []


@pytest.mark.release
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_notebook_is_in_the_gallery(site, path):
    title = nbformat.read(path, as_version=4).cells[0].source.splitlines()[0].removeprefix("# ")
    assert title in words(site / "gallery" / f"{path.stem}.html")
    assert f'href="{path.stem}.html"' in (site / "gallery" / "index.html").read_text(encoding="utf-8")


# --- what makes it ---


def test_a_notebook_is_shown_with_its_outputs_if_these_are_of_the_same_cells(extension, tmp_path):
    pages, new = extension("pages"), nbformat.v4
    (tmp_path / "executed").mkdir()
    book = new.new_notebook(cells=[new.new_markdown_cell("# A title\n\nAbout it."), new.new_code_cell("1 + 1")])
    path = tmp_path / "01_sum.ipynb"
    nbformat.write(book, path)
    picture = new.new_output("display_data", {"image/png": "aGVsbG8="})
    book.cells[1].outputs = [picture]
    nbformat.write(book, tmp_path / "executed" / path.name)
    shown = pages.newest(path, tmp_path / "executed")
    assert shown.cells[1].outputs == [picture]
    card, thumbnail = pages.card("01_sum", shown)
    assert thumbnail == b"hello"
    assert "**[A title](01_sum.ipynb)**" in card and "(01_sum.png)" in card and "About it." in card
    book.cells[1].source, book.cells[1].outputs = "1 + 2", []
    nbformat.write(book, path)
    shown = pages.newest(path, tmp_path / "executed")
    assert "no outputs" in shown.cells[1].source
    assert shown.cells[2].source == "1 + 2"
    card, thumbnail = pages.card("01_sum", shown)
    assert thumbnail == b"" and ".png" not in card


def test_every_public_name_of_a_package_is_in_its_table(extension):
    pages = extension("pages")
    for name in ("jgait.datasets", "jgait.estimators", "jgait.tune"):
        page = pages.page(name)
        assert [one for one in importlib.import_module(name).__all__ if f"`{one}`" not in page] == []


def test_a_part_of_a_docstring_is_its_beginning_or_a_section(extension):
    part = extension("docstrings").part
    waist = "jgait.estimators.waist"
    assert part(waist).startswith("Heel strikes") and "Source" not in part(waist)
    assert part(waist, "Source").startswith("A. Köse") and part(waist, "Source").rstrip().endswith("2011.")
    assert part(waist, "Sensors").startswith("`waist`, `lower_back`")
    assert "\n1. " in part(waist, "Deviations from the paper")
    with pytest.raises(ValueError, match=r"has no section 'Weather'"):
        part(waist, "Weather")


@pytest.mark.release
def test_parameters_are_shown_with_their_defaults(site):
    said = words(site / "api" / "estimators" / "leg_ekf" / "params.html")
    default = leg_params.LegParams().rollover_radius
    meaning = r"how far the ankle moves forward per radian of the shank in stance \[m\]"
    assert re.search(rf"rollover_radius: {meaning}; interval\(.*?\)\.", said)
    assert re.search(rf"rollover_radius: [^=]*= {default}\b", said)


@pytest.mark.parametrize("name", ["command-line.md", "formats.md"])
def test_what_is_written_into_pages_is_up_to_date(extension, name):
    page = (ROOT / "docs" / name).read_text(encoding="utf-8")
    assert page == extension("sources").page(name), "run `python docs/_ext/sources.py`"
