"""The command line, `jgait --help`; each command is a file of `jgait.commands`."""

import os
import sys
from pathlib import Path

try:
    import rich  # noqa: F401
    import typer
except ImportError as missing:  # the library alone does without them
    print(f"the jgait command needs its extra: pip install 'jgait[cli]' ({missing})", file=sys.stderr)
    raise SystemExit(1) from missing

import jax

from jgait.commands.datasets import sets
from jgait.commands.demo import demo
from jgait.commands.estimate import estimate
from jgait.commands.evaluate import evaluate
from jgait.commands.report import report
from jgait.commands.simulate import simulate
from jgait.commands.tune import tune

app = typer.Typer(
    help="Gait from wearable sensors: joint angles, strides, widths, contacts and distance. Begin with `jgait demo`, "
    "or with `jgait estimate FILE` on a recording of your own. Commands leave with 0 if all went well, 1 if some "
    "recordings could not be used, 2 if nothing could be done.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
for command, what in (
    (demo, "Estimate, compare with the truth, tune, judge: a first look."),
    (estimate, "Angles, strides, contacts, distance of your recordings."),
    (simulate, "Walks with known truth, as files."),
    (evaluate, "A whole cohort, compared with its reference."),
    (tune, "Learn parameters from a cohort by gradient."),
    (report, "One HTML page about a recording or a cohort."),
):
    app.command(short_help=what)(command)
app.add_typer(sets, name="datasets")


def main() -> None:
    """Run the command line: float64, and compiled programs kept between runs."""
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
