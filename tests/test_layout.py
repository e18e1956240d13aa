"""The shape of the library: imports go one way, files are short, class names are used once."""

from pathlib import Path

import layering
import pytest

ROOT = Path(__file__).parents[1]
LONGEST = 400


@pytest.fixture(scope="module")
def edges():
    found = layering.imports(ROOT)
    assert len(found) > 500
    return found


def test_the_order_names_every_file_and_folder_of_the_library():
    names = {path.stem for path in (ROOT / "jgait").iterdir()} - {"__init__", "__pycache__", "py"}
    assert names <= set(layering.ORDER)
    assert len(names) + 2 <= 23  # __init__.py and py.typed


def test_no_import_goes_up_or_in_a_circle(edges):
    assert layering.upward(edges) == []
    assert layering.circles(edges) == []


def test_no_file_is_long_and_no_class_name_is_used_twice():
    long = [p for p in layering.modules(ROOT).values() if len(p.read_text(encoding="utf-8").splitlines()) > LONGEST]
    assert long == []
    assert layering.repeated_classes(ROOT) == {}


def test_a_circle_and_an_upward_import_are_detected(tmp_path):
    files = {
        "__init__.py": "from jgait.types import A",
        "types.py": "A = 1\ndef f():\n    from jgait.io import read",
        "io/__init__.py": "from jgait.io.a import read",
        "io/a.py": "from jgait.io import b\nfrom jgait.types import A",
        "io/b.py": "import jgait.io.c\nclass Part: ...",
        "io/c.py": "from jgait.io.a import read\nclass Part: ...",
    }
    for name, text in files.items():
        path = tmp_path / "jgait" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    edges = layering.imports(tmp_path)
    assert layering.upward(edges) == [layering.Import("jgait.types", 3, "jgait.io")]
    assert layering.circles(edges) == [["jgait.io", "jgait.types"], ["jgait.io.a", "jgait.io.b", "jgait.io.c"]]
    assert layering.repeated_classes(tmp_path) == {"Part": ["jgait.io.b", "jgait.io.c"]}
