"""Stride widths of two plain shoes without a range: `gaitmap_example` and `gaitspeed` beside their markers.

The guess is the mean width of the people of the other sets; what is usual at a passing is theirs too: the mean of
`MEANS` without the set that is judged.
"""

import os
from pathlib import Path

import numpy as np

from experiments.common.recordings import attempt, available
from experiments.common.row import Row, show
from experiments.potter import capture as real
from jgait.estimators import stride_width_ekf
from jgait.estimators.stride_width_ekf import WidthParams
from jgait.geometry.vectors import GRAVITY
from jgait.types import SIDES, Estimate, Imu, Recording

MEANS = {
    "nikonpic": ((0.072, 0.100), (0.083, 0.087), (0.096, 0.109), (0.132, 0.142)),
    "gaitspeed": ((0.123, 0.142), (0.149, 0.121), (0.078, 0.115)),
    "gaitmap_example": ((0.118, 0.165),),
}
"""[m] Median width and distance at a passing of each person, by the markers (middle of heel and toe)."""

FIRST_FRAME_S = {
    "C01": {"C01_10MW_02": 129.28, "C01_10MW_03": 181.65, "C01_10MW_04": 215.75},
    "C06": {"C06_10MW_01": 24.55, "C06_10MW_02": 53.40, "C06_10MW_03": 79.99},
}
"""[s] The first frame of each trial after the left gyroscope's first sample, by the correlation of the foot's pitch
rate with the gyroscope. The third person's gyroscopes have 25 Hz, too little for `foot_ins`."""

AROUND_S, HZ = 12.0, 50.0
"""[s], [Hz] Time before and after a trial that is estimated with it; rate to which both sensors are brought."""


def rows(quick: bool) -> list[Row]:
    """On the sets that are here: mean error, over the guess, coverage."""
    sets = {}
    if available("gaitmap_example"):
        sets["gaitmap_example"] = [real.capture()]
    folder = Path(os.environ.get("JGAIT_DATA_DIR", ".")) / "gaitspeed" / "LabClinicRecordings"
    if not folder.exists():
        print("left out: gaitspeed is not in JGAIT_DATA_DIR")
    elif not quick:
        trials = [(who, trial) for who, starts in FIRST_FRAME_S.items() for trial in starts]
        read = [attempt(f"gaitspeed: {trial}", lambda p=(who, trial): gaitspeed(folder, *p)) for who, trial in trials]
        sets["gaitspeed"] = [walk for walk in read if walk is not None]
    rows, lines = [], []
    for name, walks in sets.items():
        mean = np.mean([pair for other, pairs in MEANS.items() if other != name for pair in pairs], axis=0)
        p = WidthParams(usual_passing=float(mean[1] - WidthParams().passing_share * (mean[1] - mean[0])))
        found = [attempt(name, lambda p=p, w=walk: real.errors(w, _estimate(p, w))) for walk in walks]
        if not any(one is not None for one in found):
            continue
        error, stddev, true = (
            np.concatenate([getattr(one, key) for one in found if one is not None])
            for key in ("width", "stddev", "true")
        )
        guess = np.abs(true - mean[0])
        mae, within = 100.0 * float(np.abs(error).mean()), 100.0 * float(np.mean(np.abs(error) < 2.0 * stddev))
        ratio, n = float(np.abs(error).mean() / guess.mean()), len(error)
        lines.append([name, n, mae, 100.0 * float(np.median(np.abs(error))), 100.0 * float(np.abs(error).max()),
                      100.0 * float(error.mean()), 100.0 * float(guess.mean()), ratio, within])  # fmt: skip
        line, split = f"stride width without a range, `{name}`", "usual people of the other sets"
        rows += [
            Row(f"width_without_range_cm_{name}", mae, "cm", n=n, split=split).on(f"{line}: MAE", "", "strides"),
            Row(f"width_without_range_over_guess_{name}", ratio, "ratio", n=n, split=split),
            Row(f"width_without_range_two_sigma_pct_{name}", within, "%", n=n, split=split),
        ]
    columns = ["", "n", "MAE", "median", "worst", "bias", "guess", "over the guess", "in 2σ %"]
    show("stride width without a range [cm]", columns, lines)
    for metric, unit in (("cm", "cm"), ("over_guess", "ratio")):
        values = [row.value for row in rows if row.metric.startswith(f"width_without_range_{metric}_")]
        if values:
            rows.append(Row(f"width_without_range_{metric}", max(values), unit, n=len(values), split="worst set"))
    return rows


def _estimate(p: WidthParams, walk: real.Capture) -> Estimate:
    """The estimate, with the widths of strides between the first and the last markers."""
    estimate = stride_width_ekf.estimate(p, walk.recording._replace(feet_range=None))
    strides = estimate.strides
    assert strides is not None
    inside = (strides.standing >= walk.time[0]) & (strides.standing_end <= walk.time[-1])
    return estimate._replace(strides=strides._replace(width=np.where(inside, strides.width, np.nan)))


def gaitspeed(folder: Path, who: str, trial: str) -> real.Capture:
    """A trial of `gaitspeed` with its markers, on the clock of the left gyroscope."""
    tables = {
        (side, kind): np.genfromtxt(next(folder.glob(f"{who}tmw{side[0].upper()}_*_{kind}.csv")), delimiter=",",
                                    skip_header=1, usecols=(0, 2, 3, 4, 5))
        for side in SIDES for kind in ("GYR", "ACC")
    }  # fmt: skip
    zero = tables["left", "GYR"][0, 0] / 1000.0
    frames = _markers(folder / "Vicon data" / "Raw Data" / f"{trial}.csv")
    begin = FIRST_FRAME_S[who][trial]
    time = begin + np.arange(len(frames["RHEE"])) / 100.0
    clock = np.arange(begin - AROUND_S, time[-1] + AROUND_S, 1.0 / HZ)
    sensors = {}
    for side in SIDES:
        gyr, acc = (
            np.stack(
                [np.interp(clock, table[0, 0] / 1000.0 - zero + table[:, 1], table[:, k]) for k in (2, 3, 4)], axis=1
            )
            for table in (tables[side, "GYR"], tables[side, "ACC"])
        )
        sensors[f"foot_{side}"] = Imu(clock, np.radians(gyr), GRAVITY * acc, np.ones(clock.shape, bool))
    feet = tuple(0.5 * (frames[f"{s}HEE"] + frames[f"{s}TOE"]) for s in "RL")
    known = np.isfinite(feet[0]).all(axis=1) & np.isfinite(feet[1]).all(axis=1)
    right, left = (foot[known, :2] for foot in feet)
    return real.Capture(Recording(sensors, HZ, trial, who), time[known], (right, left))


def _markers(path: Path) -> dict[str, np.ndarray]:
    """Marker → (T, 3) [m], of the block of trajectories in a file of Vicon."""
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    head = max(row for row, line in enumerate(lines) if line.startswith("Trajectories"))
    body = [line for line in lines[head + 5 :] if line.strip(", ")]
    names = lines[head + 2].split(",")
    table = np.genfromtxt(body, delimiter=",", usecols=range(max(k for k, n in enumerate(names) if n) + 3))
    return {name.rpartition(":")[2]: table[:, k : k + 3] / 1000.0 for k, name in enumerate(names) if name}
