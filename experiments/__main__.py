"""Run experiments: `python -m experiments [NAME | NAME.PART] [--quick] [--json FILE] [--figures FOLDER]`."""

import argparse
import importlib
import json
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from experiments import BENCHMARKS, EXPERIMENTS

ALL = EXPERIMENTS | BENCHMARKS


def parts(name: str) -> list[ModuleType]:
    """The modules of an experiment ("leg_ekf"), or of one of its parts ("leg_ekf.table2"), that make rows."""
    experiment, _, part = name.partition(".")
    home = importlib.import_module(f"experiments.{ALL[experiment]}")
    names = getattr(home, "PARTS", None)
    if names is None:
        return [home]
    if part and part not in names:
        raise ValueError(f"{experiment} has no part {part!r}; it has {', '.join(names)}")
    return [importlib.import_module(f"{home.__name__}.{one}") for one in ([part] if part else names)]


def main(given: Sequence[str] | None = None) -> None:
    """Run one experiment, print its table, and write its JSON."""
    parser = argparse.ArgumentParser(prog="python -m experiments", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("name", nargs="?", help=f"NAME or NAME.PART; names: {', '.join(ALL)}")
    parser.add_argument("--list", choices=("experiments", "benchmarks"), help="print the names and exit")
    parser.add_argument("--quick", action="store_true", help="a small version that only shows that the code runs")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows to this file")
    parser.add_argument("--figures", type=Path, metavar="FOLDER", help="write figures, where the experiment has them")
    chosen = parser.parse_args(given)
    if chosen.list:
        print(" ".join(BENCHMARKS if chosen.list == "benchmarks" else EXPERIMENTS))
        return
    if not chosen.name or chosen.name.partition(".")[0] not in ALL:
        parser.error(f"name one of {', '.join(ALL)}")

    import jax

    from experiments.common.row import finished, result

    jax.config.update("jax_enable_x64", True)
    try:
        modules = parts(chosen.name)
    except ValueError as error:
        parser.error(str(error))
    rows = [row for module in modules for row in module.rows(chosen.quick)]
    name = chosen.name.partition(".")[0]
    finished(chosen.name, rows)
    if chosen.figures is not None:
        for module in modules:
            if hasattr(module, "draw"):
                module.draw(rows, chosen.figures, chosen.quick)
    if chosen.json is not None:
        chosen.json.parent.mkdir(parents=True, exist_ok=True)
        chosen.json.write_text(json.dumps(result(name, chosen.quick, rows), indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
