"""Many machines: the workers of a Dask cluster, and parts of a command, one for each job of an array."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from jgait.commands.console import count, say, stop
from jgait.commands.folder import ResultsFolder, results_folder
from jgait.types import reason_of

if TYPE_CHECKING:
    from distributed import Client

PARTS = "parts"
"""Folder within the folder of results that holds a folder of each part."""

COMMAND = "command"
"""Name of the argument of a part's folder that holds the words of its command."""

Dask = Annotated[
    str | None,
    typer.Option("--dask", metavar="ADDRESS", help="Of a Dask scheduler, whose workers read the files and compute."),
]
PartText = Annotated[
    str | None,
    typer.Option("--part", metavar="K/N", help="Only this part, such as 3/20; jgait join puts all parts together."),
]
WITHOUT_VALUE, WITH_VALUE = ("--fresh",), ("--part", "--dask", "--out")
"""Options that may differ between the commands of parts, without and with a value."""


class JobPart(NamedTuple):
    """A part of the work: its number, from 1, and how many parts there are."""

    number: int
    of: int

    def __str__(self) -> str:
        return f"{self.number} of {self.of}"

    def share[T](self, items: Sequence[T]) -> list[T]:
        """The items of this part: each n-th, so that people, who are listed together, are shared among parts."""
        return list(items[self.number - 1 :: self.of])

    def place(self, out: Path) -> Path:
        """The folder of this part's results."""
        return out / PARTS / f"{self.number}-of-{self.of}"

    @contextlib.contextmanager
    def folder(
        self, out: Path, command: str, context: typer.Context, arguments: Mapping[str, Any],
        inputs: Iterable[Path | None], fresh: bool = False,
    ) -> Iterator[ResultsFolder]:  # fmt: skip
        """`results_folder` of this part, which is finished at the end of the block."""
        asked = {COMMAND: shared_words(context.obj), **arguments}
        with results_folder(self.place(out), command, asked, inputs=inputs, fresh=fresh) as folder:
            yield folder
            folder.publish([])

    def end(self, out: Path, used: int, failed: int) -> None:
        """Print what this part did; exits with code 1 if some recordings could not be used."""
        many = count(used + failed, "recording", "recordings")
        say(f"part {self}: {many}, {failed} of them failed; with all parts there: jgait join {out}")
        if failed:
            raise typer.Exit(1)


def part_of(text: str | None) -> JobPart | None:
    """The part that a text names, such as 3/20; exits with code 2 if it names none."""
    if text is None:
        return None
    number, _, of = text.partition("/")
    if not (number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
        stop(f"--part is K/N with a number K from 1 to N, such as 3/20; got {text!r}")
    return JobPart(int(number), int(of))


def shared_words(words: Sequence[str]) -> list[str]:
    """The words of a command without the options in which the commands of its parts differ."""
    kept: list[str] = []
    rest = iter(words)
    for word in rest:
        if word in WITH_VALUE:
            next(rest, None)
        elif word not in WITHOUT_VALUE and not word.startswith(tuple(f"{option}=" for option in WITH_VALUE)):
            kept.append(word)
    return kept


@contextlib.contextmanager
def client_of(address: str | None) -> "Iterator[Client | None]":
    """A client of the Dask scheduler at an address, or None; exits with code 2 if there is no scheduler."""
    if address is None:
        yield None
        return
    try:
        from distributed import Client

        client = Client(address, timeout=10)
    except ImportError:
        stop("--dask needs the package distributed: pip install 'jgait[cluster]'")
    except (OSError, ValueError) as error:
        stop(f"--dask: no Dask scheduler answers at {address}: {reason_of(error)}")
    with client:
        yield client
