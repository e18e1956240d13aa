"""A toy of each kind of part that jgait can be given, and every place that it touches.

The files lie in tests/toys as they would in the checkout. A place is a new file, a new folder with all that is in it,
or an existing file that changes by a line or two. Tests of the new part are not counted.
"""

import shutil
from pathlib import Path
from typing import NamedTuple

TOYS_AT = Path(__file__).parent / "toys"


class Toy(NamedTuple):
    """A new part."""

    kind: str  #: what it is.
    new: tuple[str, ...]  #: files and folders that it brings.
    changed: dict[str, tuple[tuple[str, str], ...]]  #: existing file → pairs (text that is there, text in its place).

    @property
    def places(self) -> tuple[str, ...]:
        return (*self.new, *self.changed)


TOYS = (
    Toy(
        "estimator",
        ("jgait/estimators/toy_speed", "docs/methods/toy_speed.md", "experiments/toy_speed.py"),
        {
            "jgait/estimators/__init__.py": (
                (
                    '    "waist": "waist.estimator",\n',
                    '    "waist": "waist.estimator",\n    "toy_speed": "toy_speed.estimator",\n',
                ),
            ),
        },
    ),
    Toy(
        "dataset",
        ("jgait/datasets/toy_walks.py", "jgait/datasets/toy_walks.json"),
        {"jgait/datasets/registry.py": (('"pyshoe_vicon")', '"pyshoe_vicon", "toy_walks")'),)},
    ),
    Toy(
        "format",
        ("jgait/io/formats/toy_text.py",),
        {
            "jgait/io/formats/registry.py": (
                (
                    '    "csv": Format(',
                    '    "toy": Format("toy_text", "Toy text", "*.toy", "all"),\n    "csv": Format(',
                ),
            )
        },
    ),
    Toy(
        "figure",
        ("jgait/plot/toy_figure.py",),
        {
            "jgait/plot/__init__.py": (
                (
                    "    from jgait.plot.tuning",
                    "    from jgait.plot.toy_figure import toy_distance\n    from jgait.plot.tuning",
                ),
                ('"training",', '"toy_distance", "training",'),
                ('    "tuning":', '    "toy_figure": ("toy_distance",),\n    "tuning":'),
            ),
            "jgait/estimators/toy_speed/about.py": (
                ("...] = ()", '...] = (EstimateFigure("toy_distance", "feet", caption="The distance in feet."),)'),
            ),
        },
    ),
    Toy(
        "command",
        ("jgait/commands/toy_hello.py",),
        {
            "jgait/cli.py": (('    "report": "', '    "toy-hello": "Greet somebody.",\n    "report": "'),),
        },
    ),
)


def extended(root: Path, folder: Path) -> None:
    """A copy of the checkout at `root` with every toy, in `folder`."""
    ignored = shutil.ignore_patterns("__pycache__")
    for name in ("jgait", "docs", "experiments"):
        shutil.copytree(root / name, folder / name, ignore=ignored)
    for name in ("README.md", "CHANGELOG.md"):
        shutil.copy(root / name, folder)
    for toy in TOYS:
        for name in toy.new:
            source, target = TOYS_AT / name, folder / name
            if source.is_dir():
                shutil.copytree(source, target, ignore=ignored)
            else:
                shutil.copy(source, target)
        for name, pairs in toy.changed.items():
            text = (folder / name).read_text(encoding="utf-8")
            for before, after in pairs:
                if text.count(before) != 1:
                    raise ValueError(f"{name} has {before!r} {text.count(before)} times, not once")
                text = text.replace(before, after)
            (folder / name).write_text(text, encoding="utf-8")
