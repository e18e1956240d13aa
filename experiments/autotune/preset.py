"""A preset of the foot: the tuning on all trials, if it is better on days left out. `make presets`."""

import hashlib
from pathlib import Path

import jax
import numpy as np

from experiments.autotune import learn, vicon
from experiments.autotune.evidence import simplest
from experiments.autotune.walks import KINDS, SET, trials
from jgait import io
from jgait.datasets import pyshoe_vicon, registry
from jgait.estimators.foot_ins import FootParams

NAME = "foot_positions"


def write(p: FootParams, before: np.ndarray, after: np.ndarray, kinds: np.ndarray, folder: Path = io.PRESETS) -> Path:
    """Write the parameters; `before` and `after` are errors of trials left out [m], `kinds` their gait."""
    files = [registry.file(SET, f"{pyshoe_vicon.ROOT}/{name}.mat")[0] for name in pyshoe_vicon.names()]
    held = {
        "error": "3-D error of the foot's path", "unit": "m", "n": before.size, "split": vicon.SPLIT,
        "before": _median(before), "after": _median(after),
        "by_kind": {
            name: {"before": _median(before[kinds == name]), "after": _median(after[kinds == name])}
            for name in KINDS if (kinds == name).any()
        },
    }  # fmt: skip
    made = {
        "loss": ",".join(f"{name}={weight:g}" for name, weight in learn.POSITION), "cohort": SET, "free": learn.FREE,
        "steps": learn.STEPS, "held_out": held,
        "recordings": len(files),
        "data": {file.name: f"sha256:{hashlib.sha256(file.read_bytes()).hexdigest()}" for file in files},
    }  # fmt: skip
    rounded = jax.tree.map(lambda v: float(f"{float(v):.5g}"), p)
    return io.write_params(folder / f"{NAME}.json", rounded, estimator="foot_ins", made=made)


def _median(errors: np.ndarray) -> float:
    return float(f"{np.median(errors):.3g}")


def main() -> None:
    """Tune on the days left out and on all days, and write the preset."""
    found = trials(False)
    if found is None:
        raise SystemExit(1)
    errors = vicon.ways(False)
    losses = {name: np.log(errors[way]) for name, way in (("defaults", "marker"), ("tuned", ""))}
    if simplest(losses, found.days) != "tuned":
        raise SystemExit("on days left out the tuning is not better by a standard error: no preset")
    print(write(vicon.fit("", learn.POSITION, False).params, errors["marker"], errors[""], found.kinds))


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
