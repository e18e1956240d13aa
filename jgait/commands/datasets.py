"""`jgait datasets`: which public recordings there are, where they lie, and how they come here."""

import typer
from rich.table import Table

from jgait.commands.console import console, stop

sets = typer.Typer(help="Public recordings with a reference.", no_args_is_help=True)


@sets.command("list")
def list_sets() -> None:
    """The public data sets that jgait reads, and which of them are here."""
    from jgait import datasets

    table = Table("set", "here", "licence", "cite")
    for name in datasets.list_datasets():
        about = datasets.info(name)
        table.add_row(name, "yes" if datasets.available(name) else "no", about.licence, about.citation)
    console.print(table)


@sets.command("path")
def path_of_set(name: str) -> None:
    """The folder in which a data set lies."""
    from jgait import datasets

    try:
        console.print(str(datasets.path(name)), soft_wrap=True)
    except (datasets.DatasetUnavailable, ValueError) as error:
        stop(str(error))


@sets.command("fetch")
def fetch_set(name: str) -> None:
    """Download a data set from its authors, each file checked by its hash."""
    from jgait import datasets

    try:
        console.print(str(datasets.fetch(name, progress=True)), soft_wrap=True)
    except Exception as error:
        stop(f"{name} could not be fetched: {error}")
