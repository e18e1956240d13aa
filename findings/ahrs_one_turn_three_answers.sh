#!/usr/bin/env bash
# ahrs 0.4.0, classes that estimate orientation from gyroscope and accelerometer.
# Expected: a level sensor turned by 90 degrees about the vertical axis reads +90 degrees
#   from every class, as they share one set of arguments (gyr, acc, frequency).
# Seen: Madgwick, Mahony, EKF and AngularRate say +90, AQUA says -90 (its quaternion is the
#   inverse), and Complementary says 0 (without a magnetometer it holds its yaw at 0).
# For gait: to swap one filter for another turns left into right, or loses the turn.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    ahrs==0.4.0 numpy==2.2.6

"$work/venv/bin/python" - <<'EOF'
import numpy as np
import ahrs

RATE = 100
gyr = np.zeros((300, 3))
gyr[100:200, 2] = np.pi / 2  # rad/s for one second; rest before and after
acc = np.tile([0.0, 0.0, 9.81], (300, 1))


def turn(name):
    """Change of yaw in degrees between the rests, w x y z taken as sensor to world."""
    inputs = {"gyr": gyr, "frequency": RATE}
    if name != "AngularRate":
        inputs["acc"] = acc
    w, x, y, z = np.asarray(getattr(ahrs.filters, name)(**inputs).Q).T
    yaw = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    return np.degrees(yaw[-1] - yaw[50])


expected = {"Madgwick": 90, "Mahony": 90, "EKF": 90, "AngularRate": 90, "AQUA": -90, "Complementary": 0}
for name, seen_before in expected.items():
    angle = turn(name)
    print(f"{name:14s} {angle:+6.1f} deg (true +90)")
    assert abs(angle - seen_before) < 1, f"{name} gave {seen_before} before"
EOF
