"""The command line in this process: words in, exit code and words out."""

from typer.testing import CliRunner

from jgait.cli import app

RUNNER = CliRunner(env={"COLUMNS": "300"})


def run(*words: object) -> tuple[int, str]:
    """The exit code and all that was written, each space one; any exception but an exit is raised."""
    result = RUNNER.invoke(app, [str(word) for word in words])
    if not isinstance(result.exception, SystemExit | None):
        raise result.exception
    return result.exit_code, " ".join(result.output.split())
