"""`jgait cache`: the compiled programs that the commands keep between runs."""

import shutil
from typing import Annotated

import typer

from jgait.commands import programs_folder
from jgait.commands.console import console, count, stop, visible


def cache(clear: Annotated[bool, typer.Option("--clear", help="Remove the programs.")] = False) -> None:
    """Show where compiled programs are kept and how much room they take, or remove them.

    Without them the next run of a command compiles again, which takes seconds. The folder stays below 1 GB.
    """
    files = [path for path in programs_folder().glob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in files) / 1e6
    summary = f"{count(len(files), 'program', 'programs')}, {size:.1f} MB, in {visible(programs_folder())}"
    if clear:
        try:
            shutil.rmtree(programs_folder())
        except FileNotFoundError:
            pass
        except OSError as error:
            stop(f"not all programs could be removed: {error}")
        summary = f"removed {summary}"
    console.print(summary, soft_wrap=True, highlight=False)
