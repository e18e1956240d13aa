"""What the experiment on the shape of the code counts, on code that breaks its rules and on code that keeps them."""

import pytest

from experiments import layout
from jgait.estimators.waist.model import MODEL

FILES = {
    "__init__.py": "",
    "types.py": "from typing import Any\ntype Values = Any\n",
    "notes.py": "def text(note): return note.code\n",
    "io/checks.py": "LOST = 1\n\ndef lost(notes, A): return [a_note.values for a_note in notes], LOST.code, A.values\n",
    "filtering/__init__.py": "",
    "filtering/model.py": (
        "class Model(NamedTuple):\n    transition: Callable[..., PyTree]\n    error_transition: int = 0\n"
        "class Shape:\n    error_shift: int\n"
    ),
    "filtering/scan.py": (
        '"""A text\nof two lines."""\n\n# a remark\ntype Many = Values\n\n\n'
        'def loose(a: Many, *b: "Values", c: int = 0) -> dict[str, Any]:\n    return {\n        "a": a,  # ] \n    }\n'
    ),
    "filtering/fast/__init__.py": "import jax.extend.core\nfrom jax.interpreters import ad\n",
    "estimators/model.py": (
        "from jax.extend.core import Primitive, jaxpr_as_fun\nimport jax\nimport jax_other._src\n"
        "def jacobian(p): return jax._src.core\ndef transition(p): return jax.extension.core\n"
        "def fitting_error(one): told, one = one; return told.found\n"
    ),
}


@pytest.fixture
def root(tmp_path):
    for name, text in FILES.items():
        path = tmp_path / "jgait" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def test_what_breaks_a_rule_is_found_in_the_source(root):
    where = "jgait/estimators/model.py"
    assert layout.names_not_allowed(root) == [f"{where}: one", f"{where}: told"]  # once each; not what is only used
    assert layout.note_readers(root) == ["io/checks.py:3"]  # a line once; not what writes notes
    assert layout.hand_jacobians(root) == ["jacobian", "error_transition"]
    assert layout.jax_internal_imports(root) == [
        "jgait.estimators.model:1 jax.extend",
        "jgait.estimators.model:4 jax._src",
        "jgait.filtering.fast:2 jax.interpreters",
    ]
    # transition, a, b, the result; not error_transition, error_shift and c
    assert layout.loose_annotations(root) == (4, 7)
    assert layout.code_lines(root / "jgait" / "filtering" / "scan.py") == 5


def test_a_filter_is_a_scan_of_primitives_of_jax():
    found = list(layout.jaxprs(MODEL))
    assert len(found) == 3
    assert [layout.missing(jaxpr) for jaxpr in found] == [[], [], []]
