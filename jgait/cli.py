"""The command line, `jgait --help`; each command is a file of `jgait.commands`."""

import importlib
import os
import sys
from pathlib import Path
from typing import Any

try:
    import rich  # noqa: F401
    import typer
    from typer.core import TyperGroup
except ImportError as missing:  # the library alone does without them
    print(f"the jgait command needs its extra: pip install 'jgait[cli]' ({missing})", file=sys.stderr)
    raise SystemExit(1) from missing

COMMANDS = {
    "demo": "Estimate, compare with the truth, tune, judge: a first look.",
    "estimate": "Angles, strides, contacts, distance of your recordings.",
    "simulate": "Walks with known truth, as files.",
    "evaluate": "A whole cohort, compared with its reference.",
    "tune": "Learn parameters from a cohort by gradient.",
    "report": "One HTML page about a recording or a cohort.",
    "datasets": "Public recordings: what there is, and how to get it.",
}
"""Name of a command → what it does."""


class Commands(TyperGroup):
    """The commands; the module of a command is imported when the command is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        """The names of the commands."""
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command by name, or None."""
        del ctx
        if cmd_name not in COMMANDS:
            return None
        function = cmd_name.replace("-", "_")
        module = importlib.import_module(f"jgait.commands.{function}")
        if cmd_name == "datasets":
            return typer.main.get_command(module.sets)
        one = typer.Typer(rich_markup_mode=None, add_completion=False)
        one.command(cmd_name)(getattr(module, function))
        return typer.main.get_command(one)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """The table of commands, without their modules."""
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


app = typer.Typer(cls=Commands, no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def about() -> None:
    """Gait from wearable sensors: joint angles, strides, widths, contacts and distance.

    Begin with `jgait demo`, or with `jgait estimate FILE` on a recording of your own. Commands leave with 0 if all went
    well, 1 if some recordings could not be used, 2 if nothing could be done.
    """


def main() -> None:
    """Run the command line: float64, and compiled programs kept between runs."""
    import jax

    jax.config.update("jax_enable_x64", True)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jgait" / "compiled"
    try:
        cache.mkdir(parents=True, exist_ok=True)
    except OSError:
        pass  # no place to keep them: every run compiles anew
    else:
        jax.config.update("jax_compilation_cache_dir", str(cache))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    app()


if __name__ == "__main__":
    main()
