#!/usr/bin/env bash
# mobgap 1.2.0 (SlZijlstra, stride length from a lower-back sensor).
# Expected: accelerations in g, the unit that many loggers write, are refused, or scaled; gravity
#   of 1 instead of 9.81 in the vertical column tells them apart.
# Seen: lengths come out, without any warning about it, 0.32 times as long: the model takes
#   the square root of the vertical displacement, and sqrt(1 / 9.81) = 0.32.
# For gait: a stride of 1.24 m becomes one of 0.40 m, which still looks like a slow, frail
#   walker and not like an error of unit.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    mobgap==1.2.0 numpy==2.5.5 scipy==1.18.1 pandas==3.1.1

"$work/venv/bin/python" - <<'EOF'
import numpy as np
import pandas as pd
from mobgap.stride_length import SlZijlstra

RATE, STEPS_PER_S = 100, 1.8
t = np.arange(20 * RATE) / RATE
up = 9.81 + 2.5 * np.cos(2 * np.pi * STEPS_PER_S * t)
side = 0.8 * np.sin(np.pi * STEPS_PER_S * t)
ahead = 1.2 * np.sin(2 * np.pi * STEPS_PER_S * t)
walk = pd.DataFrame({"acc_is": up, "acc_ml": side, "acc_pa": ahead})
contacts = pd.DataFrame({"ic": np.round(np.arange(0, 20, 1 / STEPS_PER_S) * RATE).astype(int)})
contacts.index.name = "step_id"


def mean_length(acceleration):
    data = acceleration.assign(gyr_is=0.0, gyr_ml=0.0, gyr_pa=0.0)
    result = SlZijlstra().calculate(
        data, initial_contacts=contacts, sensor_height_m=0.95, sampling_rate_hz=RATE
    )
    return result.stride_length_per_sec_["stride_length_m"].mean()


metric, in_g = mean_length(walk), mean_length(walk / 9.81)
print(f"m/s^2: mean stride length {metric:.3f} m")
print(f"g:     mean stride length {in_g:.3f} m, ratio {in_g / metric:.3f}, sqrt(1 / 9.81) = {9.81 ** -0.5:.3f}")
assert abs(in_g / metric - 9.81**-0.5) < 0.02, "the unit is noticed now"
EOF
