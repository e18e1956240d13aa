"""The documentation site: it builds without a warning, shows everything public, and asks nothing of a network."""

import ast
import importlib
import importlib.util
import inspect
import os
import re
import subprocess
import sys
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
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)], cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "WARNING" not in done.stdout + done.stderr
    return folder


def hook(name: str) -> ModuleType:
    """A module of docs/_hooks, which is no package."""
    spec = importlib.util.spec_from_file_location(f"docs_{name}", ROOT / "docs" / "_hooks" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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
    assert not (site / "_hooks").exists()
    written = [page.relative_to(ROOT / "docs").with_suffix(".html") for page in (ROOT / "docs").rglob("*.md")]
    assert len(written) > 10
    assert [str(page) for page in written if "{{ " in words(site / page)] == []


@pytest.mark.release
def test_every_public_function_and_class_has_its_place(site):
    there = set()
    for page in (site / "api").rglob("*.html"):
        there |= set(re.findall(r'id="(jgait[\w.]*)"', page.read_text(encoding="utf-8")))
    wanted = set()
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(ROOT).with_suffix("").parts
        module = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        wanted.add(module)
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                wanted.add(f"{module}.{node.name}")
    assert len(wanted) > 1000
    assert sorted(wanted - there) == []


@pytest.mark.release
@pytest.mark.parametrize("name", PACKAGES)
def test_every_method_has_its_page(site, name):
    page = site / "methods" / f"{name}.html"
    text = page.read_text(encoding="utf-8")
    headings = re.findall(r"<h2 [^>]*>(.*?)<a ", text)
    assert [heading for heading in SECTIONS if heading not in headings] == []
    assert text.count("<math ") > 5
    said = words(page)
    assert not re.search(r"\\[a-z]{2,}|\$\$", said), "a formula was left as it was written"
    rows = text[text.index('id="accuracy"') :].count("<tr>")
    assert rows >= 2, "a head and a row"


@pytest.mark.release
@pytest.mark.parametrize("name", PACKAGES)
def test_every_deviation_is_shown_with_its_number(site, name):
    package = importlib.import_module(f"jgait.estimators.{name}")
    docstring = inspect.getdoc(package)
    listed = docstring[docstring.index("Deviations") :]
    numbers = re.findall(r"^ {4}(\d+)\. ", listed, re.MULTILINE)
    text = (site / "methods" / f"{name}.html").read_text(encoding="utf-8")
    shown = re.findall(r"<strong>(\d+)\.</strong>", text[text.index('id="deviations-from-the-paper"') :])
    assert numbers
    assert shown[: len(numbers)] == numbers


@pytest.mark.release
def test_every_row_of_the_experiments_is_shown(site):
    table = (ROOT / "experiments" / "README.md").read_text(encoding="utf-8")
    commands = re.findall(r"^\|.*\| `(\w+)` \|$", table, re.MULTILINE)
    assert len(commands) > 20
    shown = re.findall(r"<td><code>(\w+)</code></td>\s*</tr>", (site / "experiments.html").read_text())
    assert shown == commands
    methods = "".join(page.read_text(encoding="utf-8") for page in (site / "methods").glob("*.html"))
    made = set(re.findall(r"Measured by the experiment <code>(\w+)</code>", methods))
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


def test_a_gallery_without_notebooks_is_a_page_that_states_it(tmp_path):
    gallery = hook("gallery")
    assert gallery.notebooks(tmp_path) == []
    assert "no notebook" in gallery.index({})


def test_a_notebook_is_shown_with_its_outputs_if_these_are_of_the_same_cells(tmp_path):
    gallery, new = hook("gallery"), nbformat.v4
    (tmp_path / "executed").mkdir()
    book = new.new_notebook(cells=[new.new_markdown_cell("# A title\n\nAbout it."), new.new_code_cell("1 + 1")])
    path = tmp_path / "01_sum.ipynb"
    nbformat.write(book, path)
    picture = new.new_output("display_data", {"image/png": "aGVsbG8="})
    book.cells[1].outputs = [new.new_output("execute_result", {"text/plain": "a two"}, execution_count=1), picture]
    nbformat.write(book, tmp_path / "executed" / path.name)
    markdown, files = gallery.page(path, tmp_path / "executed")
    assert "a two" in markdown
    assert list(files.values()) == [b"hello"]
    title, first, shown = gallery.summary(markdown)
    assert (title, first) == ("A title", "About it.")
    assert [shown] == list(files)
    book.cells[1].source, book.cells[1].outputs = "1 + 2", []
    nbformat.write(book, path)
    markdown, files = gallery.page(path, tmp_path / "executed")
    assert "a two" not in markdown
    assert files == {}


def test_sections_that_google_does_not_know_become_headings_and_numbered_text():
    equation, known = "One.\n\n    x = y", "Args:\n    p: it.\n\nThe end."
    own = "Sensors:\n    One\n    or two."
    points = "Deviations from the paper, as seen:\n    1. First,\n       long.\n    2. Second."
    text = "\n\n".join([equation, own, points, known])
    docstring = hook("docstring_sections")
    put = "**1.** First,\nlong.\n\n**2.** Second."
    headings = "**Sensors**\n\nOne\nor two.", f"**Deviations from the paper, as seen**\n\n{put}"
    assert docstring.rendered(text) == "\n\n".join([equation, *headings, known])
    intro, named = docstring.sections(text)
    assert intro == equation
    assert named["Sensors"] == "One\nor two."
    assert named["Deviations from the paper"] == f"As seen:\n\n{put}"


def test_a_record_states_its_defaults():
    text = "One.\n\nAttributes:\n    a: first,\n        on two lines.\n    b: second.\n\nEnd."
    told = hook("docstring_sections").with_defaults(text, {"a": "0.5", "c": "1"})
    assert told == text.replace("two lines.", "two lines. Default: `0.5`.")


@pytest.mark.release
def test_parameters_are_shown_with_their_defaults(site):
    said = words(site / "api" / "estimators" / "leg_ekf" / "params.html")
    default = leg_params.LegParams().rollover_radius
    meaning = r"how far the ankle moves forward per radian of the shank in stance \[m\]"
    assert re.search(rf"{meaning}; interval\(.*?\)\. Default: {default}", said)


def test_formulae_become_mathml():
    with_mathml = hook("mathml").with_mathml
    page = with_mathml(r'<p><span class="arithmatex">\(a &lt; \boldsymbol\omega\)</span></p>')
    assert re.fullmatch(r"<p><math [^>]*>.*<mi>a</mi>.*&#x0003C;.*<mi>𝝎</mi>.*</math></p>", page)
    two = "x &amp;= 1 \\\\ y &amp;= 2"
    block = with_mathml(f'<div class="arithmatex">\\[\n\\begin{{align*}} {two} \\end{{align*}}\n\\]</div>')
    assert block.startswith('<div class="formula"><math')
    assert block.count("<mtr>") == 2
    assert "text-align: right" in block
    assert "\\" not in block


def test_a_heading_of_the_readme_that_is_gone_is_named():
    sources = hook("sources")
    assert "pip install" in sources.readme("Install")
    with pytest.raises(ValueError, match=r"no heading 'Nowhere'"):
        sources.readme("Nowhere")
    with pytest.raises(ValueError, match=r"no row of none\.py"):
        sources.accuracy("none.py")
