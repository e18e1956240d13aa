"""A preset of the foot: what the tuning on all trials found, if it is better on days left out. `make presets`."""

import hashlib
from pathlib import Path

import jax
import numpy as np

from experiments.autotune import learn, vicon
from experiments.autotune.walks import KINDS, SET, options_of, trials
from jgait import io
from jgait.datasets import pyshoe_vicon, registry
from jgait.estimators.foot_ins import FootParams

NAME, WORTH = "foot_log_linear", 0.9
"""Name; largest median error of the days left out over that of the defaults with which a preset is written [1]."""


def write(p: FootParams, before: np.ndarray, after: np.ndarray, kinds: np.ndarray, folder: Path = io.PRESETS) -> Path:
    """Write the parameters; `before` and `after` are the errors of the trials [m], `kinds` their gait."""
    options = options_of(vicon.NOISE)
    files = [registry.file(SET, f"{pyshoe_vicon.ROOT}/{name}.mat")[0] for name in pyshoe_vicon.names()]
    held = {
        "error": "3-D error of the foot's path", "unit": "m", "n": before.size, "split": vicon.SPLIT,
        "before": _median(before), "after": _median(after),
        "by_kind": {
            name: {"before": _median(before[kinds == name]), "after": _median(after[kinds == name])}
            for name in KINDS if (kinds == name).any()
        },
    }  # fmt: skip
    free = [name for name in learn.FREE if name not in learn.MARKER]
    made = {
        "loss": "position_log=1", "cohort": SET, "free": free, "steps": learn.STEPS, "held_out": held,
        "options": {"soft": options.soft, "noise": options.noise}, "recordings": len(files),
        "data": {file.name: f"sha256:{hashlib.sha256(file.read_bytes()).hexdigest()}" for file in files},
    }  # fmt: skip
    rounded = jax.tree.map(lambda v: float(f"{float(v):.5g}"), p)
    return io.write_params(folder / f"{NAME}.json", rounded, estimator="foot_ins", made=made)


def _median(errors: np.ndarray) -> float:
    return float(f"{np.median(errors):.3g}")


def main() -> None:
    """Tune on the days left out and on all days, and write the preset."""
    found = trials(vicon.NOISE, False)
    if found is None:
        raise SystemExit(1)
    before, after = (one(vicon.NOISE, False).error for one in (vicon.marked, vicon.tuned))
    if np.median(after) > WORTH * np.median(before):
        raise SystemExit(f"median error {np.median(before):.3f} m before, {np.median(after):.3f} m after: no preset")
    own = vicon.all_days(vicon.NOISE)._replace(tracked_point=FootParams().tracked_point)  # of the sensor itself
    print(write(own, before, after, found.kinds))


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
