#!/usr/bin/env bash
# imufusion 1.3.3 (Fusion AHRS).
# Expected: a filter that takes neither a time step nor a rate with each sample
#   would refuse to run, or warn, until it has been told the sampling rate.
# Seen: it assumes 100 Hz. The same turn of 60 degrees reads 30 degrees from a
#   recording at 50 Hz and 120 degrees from one at 200 Hz, without a warning.
#   With AhrsSettings.sample_rate set, all three give 60 degrees.
# For gait: shank and foot sensors often run at 50, 128 or 200 Hz, so that turning
#   angles come out wrong by the ratio of the rates.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    imufusion==1.3.3 numpy==2.2.6

"$work/venv/bin/python" - <<'EOF'
import numpy as np
import imufusion


def yaw_after_turn(rate, told):
    """Yaw, in degrees, after one second at 60 deg/s about the vertical axis."""
    ahrs = imufusion.Ahrs()
    settings = imufusion.AhrsSettings()
    if told:
        settings.sample_rate = rate
    ahrs.set_settings(settings)
    up = np.array([0.0, 0.0, 1.0])
    for _ in range(10 * rate):  # rest, longer than the filter's start-up
        ahrs.update_no_magnetometer(np.zeros(3), up)
    for _ in range(rate):
        ahrs.update_no_magnetometer(np.array([0.0, 0.0, 60.0]), up)
    w, x, y, z = ahrs.get_quaternion()
    return np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


print("default of sample_rate:", imufusion.AhrsSettings().sample_rate, "Hz")
for rate in (50, 100, 200):
    silent, told = yaw_after_turn(rate, False), yaw_after_turn(rate, True)
    print(f"{rate:3d} Hz: default {silent:6.1f} deg, rate told {told:6.1f} deg, true 60.0 deg")
    assert abs(silent - 60 * rate / 100) < 0.5, "the default rate no longer acts"
    assert abs(told - 60) < 0.5, "the rate told no longer acts"
EOF
