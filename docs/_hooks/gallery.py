"""The notebooks as pages, with their outputs where `make docs` has executed them; none is needed."""

import re
from pathlib import Path

import nbformat
from nbconvert import MarkdownExporter

ROOT = Path(__file__).parents[2]
EXECUTED = ROOT / "build" / "notebooks"


def notebooks(folder: Path) -> list[Path]:
    """The notebooks of a folder, in the order of their names."""
    return sorted(folder.glob("*.ipynb"))


def newest(path: Path, executed: Path = EXECUTED) -> nbformat.NotebookNode:
    """A notebook with outputs if there is an executed copy with the same cells, else as it is."""
    own = nbformat.read(path, as_version=4)
    copy = executed / path.name
    if copy.exists():
        other = nbformat.read(copy, as_version=4)
        if [cell.source for cell in other.cells] == [cell.source for cell in own.cells]:
            return other
    return own


def page(path: Path, executed: Path = EXECUTED) -> tuple[str, dict[str, bytes]]:
    """A notebook as Markdown, and the files that it shows, by name."""
    notebook = newest(path, executed)
    for number, cell in enumerate(notebook.cells):
        if cell.cell_type == "code" and not cell.source.strip():
            notebook.cells[number] = nbformat.v4.new_markdown_cell("")
    body, resources = MarkdownExporter().from_notebook_node(notebook, {"unique_key": path.stem})
    files = {str(name): data for name, data in resources.get("outputs", {}).items()}
    body = re.sub(r"<style scoped>.*?</style>", "", body, flags=re.DOTALL)
    body = body.replace('<table border="1" class="dataframe">', "<table>")
    body = re.sub(r"\x1b\[[0-9;]*m", "", body)
    ran = any(cell.get("outputs") for cell in notebook.cells)
    note = "" if ran else " Its outputs are not shown here: run it, or `make docs`."
    return body.rstrip() + f"\n\n---\n\nThis page is `notebooks/{path.name}`.{note}\n", files


def summary(markdown: str) -> tuple[str, str, str | None]:
    """Title, first paragraph and first picture of a page."""
    heading = re.search(r"^# (.+)$", markdown, re.MULTILINE)
    rest = markdown[heading.end() :] if heading else markdown
    first = next((block for block in rest.split("\n\n") if block.strip() and block.strip()[0] not in "#`!<"), "")
    picture = re.search(r"!\[[^\]]*\]\(([^)]+)\)", rest)
    return (heading[1] if heading else "Notebook"), " ".join(first.split()), picture[1] if picture else None


def index(pages: dict[str, str]) -> str:
    """The gallery's first page, of the pages by their names."""
    lines = ["# Gallery", ""]
    if not pages:
        return "\n".join([*lines, "There is no notebook in this checkout.", ""])
    lines += ["Notebooks of `notebooks/`, each run by the tests. Open one with Jupyter, or read it here.", ""]
    lines += ['<div class="grid cards" markdown>', ""]
    for name, markdown in pages.items():
        title, first, picture = summary(markdown)
        lines += [f"-   **[{title}]({name})**", ""]
        if picture:
            lines += [f"    [![{title}]({picture})]({name})", ""]
        lines += [f"    {first}", ""]
    return "\n".join([*lines, "</div>", ""])
