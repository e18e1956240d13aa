#!/usr/bin/env bash
# scikit-digital-health 0.17.18 (skdh.io.ReadCwa and skdh.gait.GaitLumbar).
# Expected: what the package's reader returns can go into the package's gait analysis as it is.
# Seen: by their docstrings ReadCwa gives deg/s and GaitLumbar takes rad/s; no unit is passed on
#   and no step between them converts. The same made-up straight walk has no stride in a turn
#   in rad/s and all of them in deg/s; stride times and lengths are the same in both.
# For gait: strides in turns are usually left out of the averages, so that a straight walk may
#   leave nothing; the other outcomes give no hint of it.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    scikit-digital-health==0.17.18 numpy==2.5.5 scipy==1.18.1 pandas==3.1.1

"$work/venv/bin/python" -W ignore - <<'EOF'
import numpy as np
from skdh.gait import GaitLumbar
from skdh.io import ReadCwa

for owner, doc, unit in (("ReadCwa", ReadCwa.__doc__, "deg/s"), ("GaitLumbar", GaitLumbar.predict.__doc__, "rad/s")):
    print(f"{owner} documents {unit}:", unit in doc)
    assert unit in doc, "the unit in the documentation has changed"

rate, steps = 50.0, 1.8
t = np.arange(int(60 * rate)) / rate
step, stride = 2 * np.pi * steps * t, np.pi * steps * t
acc = np.c_[0.2 * np.sin(step), 1 + 0.25 * np.cos(step) + 0.05 * np.cos(2 * step), 0.08 * np.sin(stride)]
gyr = np.c_[0.05 * np.sin(step), 0.35 * np.sin(stride), 0.1 * np.sin(stride + 1)]


def walk(gyro):
    """Strides in turns, all strides, mean stride length."""
    out = GaitLumbar().predict(time=1.6e9 + t, accel=acc, gyro=gyro, height=1.75, gait_pred=True, fs=rate)
    turn = np.asarray(out["Turn"])
    return int((turn > 0).sum()), len(turn), float(np.nanmean(out["stride length"]))


for unit, gyro in (("rad/s", gyr), ("deg/s", np.degrees(gyr))):
    turning, count, length = walk(gyro)
    print(f"{unit}: {turning} of {count} strides in a turn, mean stride length {length:.2f} m")
    assert turning == (0 if unit == "rad/s" else count), "the unit acts differently now"
EOF
