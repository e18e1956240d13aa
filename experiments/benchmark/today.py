"""An earlier build of this repository beside the present one: both run in turn, with the same interpreter and packages.

The earlier build comes from the history of the checkout. Each build has a process of its own, which compiles programs
once and then runs them when it is asked, so that both see the same machine. Run as a script, this file is that process:
it takes jgait and the problems of `benchmark_core` from the folder of its build.
"""

import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self

from experiments.common.process import ROOT, environment

COMMIT = "25451b24"
"""The earlier build."""


@contextmanager
def earlier() -> Iterator[Path | None]:
    """A folder with the earlier build, deleted at the end; None, with a printed reason, where the history is absent."""
    command = ["git", "archive", COMMIT, "jgait", "experiments"]
    reason = ""
    try:
        made = subprocess.run(command, cwd=ROOT, capture_output=True, check=False)
        reason = made.stderr.decode().strip() if made.returncode else ""
    except OSError as error:
        reason = str(error)
    if reason:
        print(f"left out: ratios over the build {COMMIT}: {reason}")
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="jgait-earlier-") as folder:
        with tarfile.open(fileobj=io.BytesIO(made.stdout)) as files:
            files.extractall(folder, filter="data")
        yield Path(folder)


def variables(tree: Path) -> dict[str, str]:
    """The variables of a process that takes jgait and the experiments from a folder."""
    others = filter(None, [os.environ.get("PYTHONPATH")])
    return {**environment(), "PYTHONPATH": os.pathsep.join([str(tree), *others])}


class Build:
    """The process of a build, which compiles and runs smoothers: `model` is "foot" or "leg", `count` the batch."""

    def __init__(self, tree: Path) -> None:
        self.tree = tree

    def __enter__(self) -> Self:
        self.errors = tempfile.TemporaryFile("w+")
        command = [sys.executable, "-P", __file__]  # -P: the files beside this one are no modules of that process
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.errors, text=True, cwd=self.tree,
            env=variables(self.tree),
        )  # fmt: skip
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()
        self.errors.close()

    def compiled(self, model: str, count: int) -> dict[str, float]:
        """Processor seconds of "trace" and "compile"; they are 0 where a batch is split between threads."""
        seconds: dict[str, float] = self._answer("compiled", model, count)
        return seconds

    def seconds(self, model: str, count: int) -> float:
        """Seconds of one run of a program that was compiled; a mean, if several fill 20 ms."""
        seconds: float = self._answer("seconds", model, count)
        return seconds

    def _answer(self, *request: Any) -> Any:
        questions, replies = self.process.stdin, self.process.stdout
        assert questions is not None
        assert replies is not None
        with suppress(BrokenPipeError):  # then there is no answer either
            print(json.dumps(request), file=questions, flush=True)
        answer = replies.readline()
        if not answer:
            self.errors.seek(0)
            raise RuntimeError(f"the process of the build in {self.tree} failed: {self.errors.read()[-3000:]}")
        return json.loads(answer)


def _answers() -> None:
    """Answer requests, one JSON a line, until the input ends."""
    import jax
    import jax.numpy as jnp

    import jgait
    from experiments.benchmark import core
    from experiments.benchmark.timing import Program, interleaved

    replies, sys.stdout = sys.stdout, sys.stderr
    if not Path(jgait.__file__).is_relative_to(Path.cwd()):
        raise RuntimeError(f"jgait is that of {jgait.__file__}, not of {Path.cwd()}")
    jax.config.update("jax_cpu_enable_async_dispatch", False)  # else two threads compute one after the other
    programs: dict[tuple[str, int], Program] = {}

    def compiled(model: str, count: int) -> dict[str, float]:
        problem = getattr(core, model)(count, core.SAMPLES, jnp.float32)

        def run(batch: Any, logs: Any) -> Any:
            return core.smoother(problem, batch, logs)

        arguments, steps, traced = (run, problem.batch, problem.logs), count * core.SAMPLES, 0.0
        if count < 64:
            made, traced = core.program(*arguments, steps=steps)
        else:
            made = core.on_all_cores(*arguments, steps=steps)
        programs[model, count] = made
        made.run()
        return {"trace": traced, "compile": made.compile_seconds}

    def seconds(model: str, count: int) -> float:
        return interleaved({model: programs[model, count]}, 1)[model]

    known = {"compiled": compiled, "seconds": seconds}
    for line in sys.stdin:
        kind, *arguments = json.loads(line)
        print(json.dumps(known[kind](*arguments)), file=replies, flush=True)


if __name__ == "__main__":
    _answers()
