"""Numbers of the movement of recorded people: `movement.json`, which names its source."""

import json
from pathlib import Path
from typing import Any

TABLES: dict[str, Any] = json.loads(Path(__file__).with_name("movement.json").read_text(encoding="utf-8"))
"""`experiments.people.shapes` derives them: tables of `shapes`, parameters of the gait (`person.RECORDED`), and the
powers of the stride with which some of them grow (`population.manner`)."""
