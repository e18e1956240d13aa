#!/usr/bin/env bash
# KielMAT 0.0.5 (PhysicalActivityMonitoring.detect), with pandas 2.2.3.
# Expected: the table of accelerations given is read only; two calls give the same answer.
# Seen: with acceleration_unit="m/s^2" the caller's table is divided by 9.81 in place and gains
#   three columns. The second call on it divides again: ten minutes of light activity
#   (ENMO near 95 mg) have become none.
# For gait: whatever runs after it on the same table (steps, stride lengths) reads g as
#   m/s^2, and a notebook's cell gives another result when run twice.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    numpy==2.2.6 pandas==2.2.3 scipy==1.15.3 matplotlib==3.10.3 pywavelets==1.8.0
# only the parts that this module imports
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile --no-deps kielmat==0.0.5

MPLBACKEND=Agg MPLCONFIGDIR="$work" "$work/venv/bin/python" -W ignore - <<'EOF'
import numpy as np
import pandas as pd
from kielmat.modules.pam import PhysicalActivityMonitoring

n = 50 * 600
t = np.arange(n) / 50
table = pd.DataFrame(
    {"x": 9.81 * (1 + 0.3 * np.sin(np.pi * t)), "y": 0.0, "z": 0.0},
    index=pd.date_range("2024-01-01 10:00", periods=n, freq="20ms", name="timestamp"),
)


def light_minutes():
    """Minutes of light activity, as the module reports them."""
    pam = PhysicalActivityMonitoring()
    pam.detect(
        data=table,
        acceleration_unit="m/s^2",
        sampling_freq_Hz=50,
        thresholds_mg={"sedentary_threshold": 45, "light_threshold": 100, "moderate_threshold": 400},
        epoch_duration_sec=10,
        plot=False,
    )
    day = pam.physical_activities_.iloc[0]
    return float(day["light_time_min"])


print(f"before: mean of x {table.x.mean():.3f}, columns {list(table.columns)}")
first = light_minutes()
mean, columns = table.x.mean(), list(table.columns)
print(f"after the first call: mean of x {mean:.3f}, columns {columns}")
second = light_minutes()
print(f"after the second call: mean of x {table.x.mean():.3f}")
print(f"first call:  {first} min of light activity")
print(f"second call: {second} min of light activity")
assert abs(mean - 1) < 1e-6 and len(columns) == 6, "the caller's table is left alone now"
assert first == 10 and second == 0
EOF
