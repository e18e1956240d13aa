"""`jgait datasets`: list the public data sets, show their folders, and fetch them."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from jgait import datasets
from jgait.commands.console import Bar, progress, refused, say, show, write_json

Json = Annotated[Path | None, typer.Option("--json", help="Write the same as JSON to this file.")]

sets = typer.Typer(
    help="Public recordings with a reference.", no_args_is_help=True, rich_markup_mode=None, add_completion=False
)


@sets.command("list")
def list_sets(json_file: Json = None) -> None:
    """List the public data sets that jgait reads, and which of them are on this computer."""
    listed = {}
    for name in datasets.list_datasets():
        about = datasets.info(name)
        listed[name] = {"here": datasets.available(name), "licence": about.licence, "citation": about.citation}
    rows = [(name, "yes" if row["here"] else "no", row["licence"], row["citation"]) for name, row in listed.items()]
    show("set", "here", "licence", "cite", rows=rows, left=4)
    write_json(json_file, listed)


@sets.command("path")
def path_of_set(name: str, json_file: Json = None) -> None:
    """Print the folder of a data set."""
    _show(name, json_file, datasets.path)


@sets.command("fetch")
def fetch_set(name: str, json_file: Json = None) -> None:
    """Download a data set from its authors; each file is checked by its hash."""
    _show(name, json_file, download)


def download(name: str) -> Path:
    """Download what is missing of a data set, under a progress bar; its folder in the download cache."""
    with progress() as bars:
        return datasets.fetch(name, progress=Bar(bars))


def _show(name: str, json_file: Path | None, locate: Callable[[str], Path]) -> None:
    """Print the folder of a data set; exits with code 2 if there is none."""
    with refused("", Exception):
        folder = str(locate(name))
    say(folder)
    write_json(json_file, {name: folder})
