"""The command line: `jgait demo`, `estimate`, `evaluate`, `tune`, `datasets`; each in a file of `jgait.commands`."""

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
from jgait.commands.tune import tune

app = typer.Typer(
    help="Gait from wearable sensors: estimate, tune by gradient, judge.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
for command in (demo, estimate, evaluate, tune):
    app.command()(command)
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
