"""The command line, `jgait --help`; each command is a file of `jgait.commands`."""

import contextlib
import difflib
import gc
import importlib
import os
import signal
import sys
from pathlib import Path
from typing import Any

try:
    import rich  # noqa: F401
    import typer
    from typer.core import TyperCommand, TyperGroup
except ImportError as missing:  # the library alone does without them
    needed = f"the jgait command needs its extra: pip install 'jgait[cli]' ({missing})"
    if Path(sys.argv[0]).stem != "jgait":  # a module that is imported, and not the command
        raise ImportError(needed) from missing
    print(needed, file=sys.stderr)
    raise SystemExit(1) from missing

from jgait.commands import programs_folder

COMMANDS = {
    "demo": "Estimate, compare with the truth, tune, judge: a first look.",
    "inspect": "What is understood of files: sensors, places, units, losses.",
    "estimate": "Angles, strides, contacts, distance of your recordings.",
    "simulate": "Walks with known truth, as files.",
    "evaluate": "A whole cohort, compared with its reference.",
    "tune": "Learn parameters from a cohort by gradient.",
    "join": "Parts of a job array, put together.",
    "presets": "Tuned parameters that come with jgait.",
    "report": "One HTML page about a recording or a cohort.",
    "explain": "Which assumption moves a number of a recording.",
    "plan": "Which sensors a study needs: errors of set-ups.",
    "export": "The estimators sample by sample, as programs that run without jgait.",
    "datasets": "Public recordings: what there is, and how to get it.",
    "cache": "Compiled programs kept between runs: their size; remove them.",
}
"""Name of a command → what it does."""


class Interrupted(KeyboardInterrupt):
    """A signal that ends the command; after a bare `KeyboardInterrupt` within `exec`, `python -m` ends as killed."""


_kept: list[Path] = []
"""The folder of compiled programs, if `main` could make it."""


class Command(TyperCommand):
    """A command; the values of `--option` are listed at the end of its help alone, as all estimators are read then."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """The end of the help."""
        if any(parameter.name == "option" for parameter in self.params):
            from jgait.commands.options import epilog

            self.epilog = epilog()
        super().format_epilog(ctx, formatter)


class Commands(TyperGroup):
    """The commands; the module of a command is imported when the command is called."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The command line; `ctx.obj` keeps its words as they were given."""
        ctx.obj = tuple(args)
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        """The names of the commands."""
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command by name, or None; a misspelt name is refused with the nearest one."""
        if cmd_name not in COMMANDS:
            near = difflib.get_close_matches(cmd_name, COMMANDS, 1)
            return ctx.fail(f"No such command {cmd_name!r}; did you mean {near[0]!r}?") if near else None
        if _kept:
            from jgait.estimators import programs

            programs.keep(_kept[0])
        function = cmd_name.replace("-", "_")
        module = importlib.import_module(f"jgait.commands.{function}")
        if cmd_name == "datasets":
            return typer.main.get_command(module.sets)
        command_app = typer.Typer(rich_markup_mode=None, add_completion=False)
        command_app.command(cmd_name, cls=Command)(getattr(module, function))
        return typer.main.get_command(command_app)

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
    """Run the command line: float64, on the CPU unless `JAX_PLATFORMS` states another device, compiled programs kept.

    JAX is imported by the command.
    """
    gc.set_threshold(100_000)  # imports make many objects and no garbage
    os.environ["JAX_ENABLE_X64"] = "1"
    os.environ.setdefault("JAX_PLATFORMS", "cpu")  # a GPU takes longer for one recording
    with contextlib.suppress(OSError):  # no place to keep them: every run compiles anew
        programs_folder().mkdir(parents=True, exist_ok=True)
        _kept.append(programs_folder())
        os.environ["JAX_COMPILATION_CACHE_DIR"] = str(programs_folder())
        os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.2"
    ended = [signal.SIGINT]

    def interrupted(number: int, _: object) -> None:
        ended.append(signal.Signals(number))
        raise Interrupted  # so that a command removes what it began

    signal.signal(signal.SIGTERM, interrupted)
    signal.signal(signal.SIGINT, interrupted)
    try:
        app()
    except (KeyboardInterrupt, SystemExit) as end:
        if isinstance(end, SystemExit) and end.code != 128 + signal.SIGINT:  # as click ends after Ctrl-C
            raise
        print("jgait: interrupted", file=sys.stderr)
        raise SystemExit(128 + ended[-1]) from None
    except RuntimeError as error:  # of a compiled program, in a command that does not go on with other recordings
        from jgait.types import COMPILED_FAILED, reason_of

        reason = reason_of(error)
        if COMPILED_FAILED not in reason:
            raise
        print(f"jgait: {reason}", file=sys.stderr)
        raise SystemExit(2) from error
    finally:  # from here on nothing is left to remove
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    main()
