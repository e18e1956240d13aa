"""`movement.json` of `jgait.simulate`: read and written."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from jgait import simulate

FILE = Path(simulate.__file__).with_name("movement.json")


def tables() -> dict[str, Any]:
    """What the file holds, with arrays for tables."""
    found = json.loads(FILE.read_text(encoding="utf-8"))
    return found | {name: np.array(found[name]) for name in ("pelvis", "feet", "skin")}


def write(tables: dict[str, Any]) -> None:
    """The file."""
    lines = []
    for name, table in tables.items():
        if isinstance(table, np.ndarray):
            blocks = ["[" + rows(block) + "]" for block in table] if table.ndim == 3 else [rows(table)]
            lines.append(f' "{name}": [\n  ' + ",\n  ".join(blocks) + "\n ]")
        else:
            lines.append(f' "{name}": {json.dumps(table)}')
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def rows(table: np.ndarray) -> str:
    """The rows of a table, a line each."""
    return ",\n   ".join(json.dumps([float(f"{value:.4g}") for value in row]) for row in table)
