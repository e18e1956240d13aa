"""Lines of code that estimates and that no recording of the panel enters: a rule there pays for nobody."""

import inspect
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jgait
from experiments.ablation.panel import panel
from experiments.common.row import Row, show
from jgait.types import RecordingError

FOLDERS = (
    "estimators",
    "events",
    "mounting",
    "quality",
    "signal",
    "notes.py",
    "io/checks",
    "io/clock.py",
    "io/recording.py",
)
"""What estimates and checks a recording, in jgait/."""

TOOL = sys.monitoring.COVERAGE_ID


@contextmanager
def entered(folder: Path) -> Iterator[set[tuple[str, int]]]:
    """The file and number of every line of a folder's code that runs meanwhile."""
    found: set[tuple[str, int]] = set()

    def line(code: types.CodeType, number: int) -> Any:
        if code.co_filename.startswith(str(folder)):
            found.add((code.co_filename, number))
        return sys.monitoring.DISABLE

    sys.monitoring.use_tool_id(TOOL, "jgait")
    sys.monitoring.register_callback(TOOL, sys.monitoring.events.LINE, line)
    sys.monitoring.set_events(TOOL, sys.monitoring.events.LINE)
    try:
        yield found
    finally:
        sys.monitoring.set_events(TOOL, 0)
        sys.monitoring.free_tool_id(TOOL)


def lines_of(path: Path) -> set[int]:
    """The numbers of the lines within functions of a file that can run."""
    found: set[int] = set()
    parts = [
        part for part in compile(path.read_text(), str(path), "exec").co_consts if isinstance(part, types.CodeType)
    ]
    while parts:
        part = parts.pop()
        parts += [one for one in part.co_consts if isinstance(one, types.CodeType)]
        if part.co_flags & inspect.CO_OPTIMIZED:  # a function's, not a class's, which runs on import
            found |= {number for *_, number in part.co_lines() if number and number != part.co_firstlineno}
    return found


def files(folders: tuple[str, ...]) -> list[Path]:
    """The files of folders, and files, of jgait."""
    home = Path(jgait.__file__).parent
    return [p for f in folders for p in ([home / f] if f.endswith(".py") else sorted((home / f).rglob("*.py")))]


def rows(quick: bool) -> list[Row]:
    """Analyse every recording, and print the lines that none entered."""
    home = Path(jgait.__file__).parent
    count = 0
    with entered(home) as found:
        for name, made in panel(quick):
            count += 1
            try:
                jgait.analyse(made(), {"height": 1.75})
            except RecordingError as error:
                print(f"{name}: {' '.join(str(error).split())[:100]}")
    total = missed = 0
    for path in files(FOLDERS):
        every = lines_of(path)
        never = sorted(every - {number for file, number in found if file == str(path)})
        total, missed = total + len(every), missed + len(never)
        if never:
            print(f"{path.relative_to(home)}: {len(never)} of {len(every)}: {', '.join(map(str, never))}")
    row = Row("never_entered_pct", 100.0 * missed / max(total, 1), "%", n=count, of="recordings")
    show("lines that no recording enters", ["metric", "%", "recordings"], [[row.metric, row.value, row.n]])
    return [row]
