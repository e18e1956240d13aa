"""Output of the commands: messages, JSON files, progress bars, and exit with an error message."""

import contextlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from jaxtyping import PyTree
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from jgait.io.atomic import write_text
from jgait.io.flags import GRADES, Flag
from jgait.notes import by_reason, printable
from jgait.types import reason_of

if TYPE_CHECKING:
    from jgait.report import page

console = Console()
errors = Console(stderr=True)


def visible(text: object) -> str:
    """A text, perhaps with names from files, as the terminal shows it: without markup and control characters."""
    return escape(printable(str(text)))


def wrote(files: Iterable[Path]) -> None:
    """Print the files that were written."""
    console.print("wrote " + visible(", ".join(map(str, files))), soft_wrap=True, highlight=False)


def stop(message: str) -> NoReturn:
    """Print the reason of a failure, and exit with code 2."""
    errors.print(f"[bold red]jgait:[/] {visible(message)}", highlight=False, soft_wrap=True)
    raise typer.Exit(2)


Json = Annotated[Path | None, typer.Option("--json", help="Write the numbers here.")]
Fresh = Annotated[bool, typer.Option("--fresh", help="Delete the results of an earlier run in the folder.")]


def write_json(file: Path | None, content: object) -> None:
    """Write the numbers as JSON if a file is given; exits with code 2 if it cannot be written."""
    if file is not None:
        write(file, json.dumps(plain(content), indent=1, ensure_ascii=False, default=str) + "\n")


def plain(value: PyTree) -> PyTree:
    """A value converted for JSON: no NumPy types, and null for numbers that are not finite."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(name): plain(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write(file: Path, text: str) -> None:
    """Write a text into a folder that is made; exits with code 2 if it cannot be written."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_text(file, text)
    except OSError as error:
        stop(f"{file} could not be written: {error}")


class Bar:
    """One progress bar, updated for each task; in a file or a pipe, a line every 20 s."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.task = progress.add_task("starting", total=None)
        self.stated = progress.get_time()

    def __call__(self, what: str, done: int, total: int | None) -> None:
        """Show the name of the task, and the finished part of the total; with 0 finished the clock starts anew."""
        if not done:
            self.progress.reset(self.task, total=total)
        self.progress.update(self.task, description=visible(what), completed=done, total=total)
        now = self.progress.get_time()
        if not errors.is_terminal and now - self.stated > 20.0:
            self.stated = now
            errors.print(visible(what) + (f": {done} of {total}" if total else ""), highlight=False, soft_wrap=True)

    def begin(self, what: str) -> None:
        """Show a task whose total is not known, and which may take minutes; in a file or a pipe, its line comes now."""
        self.stated = -math.inf
        self(what, 0, None)


def progress() -> Progress:
    """Progress bars that disappear at the end of the `with` block."""
    return Progress(
        TextColumn("{task.description}"), BarColumn(bar_width=30), TimeElapsedColumn(), TimeRemainingColumn(),
        console=errors, transient=True,
    )  # fmt: skip


def say_failures(failures: list[tuple[str, str]], most: int = 20) -> None:
    """Print the recordings that could not be used, those with the same reason in one line."""
    reasons = [*by_reason(failures).items()]
    for reason, names in reasons[:most]:
        errors.print(f"[bold red]{visible(names)}:[/] {visible(reason)}", highlight=False, soft_wrap=True)
    if len(reasons) > most:
        errors.print(f"… and {count(len(reasons) - most, 'more reason', 'more reasons')}", highlight=False)


def note(message: object) -> None:
    """Print a note that is no error."""
    errors.print(visible(message), highlight=False, style="yellow", soft_wrap=True)


def count(number: int, singular: str, plural: str) -> str:
    """A number with a noun in the singular or plural."""
    return f"{number} {singular if number == 1 else plural}"


def show(
    *headings: str, rows: Iterable[Sequence[object]], below: Iterable[Sequence[object]] = (), left: int = 1,
    title: str | None = None,
) -> None:  # fmt: skip
    """Print a table, its first columns aligned left; rows may be shorter than the headings, `below` is a section of its
    own.
    """
    table = Table(title=title, title_justify="left")
    for number, heading in enumerate(headings):
        table.add_column(escape(heading), justify="left" if number < left else "right", overflow="fold")
    for part in (rows, below):
        for row in part:
            table.add_row(*map(visible, row))
        table.add_section()
    console.print(table)


def show_table(made: "page.Table", title: str | None = None) -> None:
    """Print a table of a page, and how to read it."""
    show(*made.columns, rows=([cell.text for cell in row] for row in made.rows), title=title)
    console.print(visible(made.caption), style="dim", highlight=False)


def say(text: object, style: str = "") -> None:
    """Print a sentence, as it is."""
    console.print(visible(text), style=style, highlight=False, soft_wrap=True)


def say_flags(flags: Sequence[Flag], where: str, most: int = 5) -> None:
    """Print the first flags of a cohort, and `where` all are; nothing if there are none."""
    for flag in flags[:most]:
        note(f"{GRADES[flag.grade]}: {flag.text}")
    left = max(len(flags) - most, 0)
    if flags:
        note(f"{f'{left} more, and ' if left else ''}all sentences: {where}")


@contextlib.contextmanager
def refused(what: str = "", *more: type[Exception]) -> Iterator[None]:
    """Exit with code 2 and a message that begins with `what` if a value or a file is wrong, or `more` is raised."""
    kinds: tuple[type[Exception], ...] = (ValueError, OSError, *more)
    try:
        yield
    except kinds as error:
        stop(f"{what}{reason_of(error) if isinstance(error, OSError) else error}")
