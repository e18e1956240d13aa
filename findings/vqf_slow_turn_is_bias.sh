#!/usr/bin/env bash
# vqf 2.1.2, default parameters, no magnetometer.
# Expected: a level sensor that turns at 1.5 deg/s for a minute has turned by 90 degrees.
# Seen: below 2 deg/s the steady turn is taken for rest; its rate becomes the estimate of
#   the gyroscope's bias, and the heading moves by less than 3 degrees. At 2.5 deg/s
#   the whole turn is seen. With restBiasEstEnabled=False the slow turn is seen too.
# For gait: slow, even turns (standing on a turntable for calibration, shuffling round
#   on the spot) vanish from the heading.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    vqf==2.1.2 numpy==2.2.6

"$work/venv/bin/python" - <<'EOF'
import numpy as np
from vqf import VQF

RATE = 100


def heading(deg_per_s, **settings):
    """Degrees turned in 60 s as the filter sees it, and its estimate of the bias."""
    n = 60 * RATE
    gyr = np.tile([0.0, 0.0, np.radians(deg_per_s)], (n, 1))
    acc = np.tile([0.0, 0.0, 9.81], (n, 1))
    out = VQF(1 / RATE, **settings).updateBatch(gyr, acc)
    q = out["quat6D"]
    turned = np.degrees(np.unwrap(2 * np.arctan2(q[:, 3], q[:, 0])))[-1]
    return turned, np.degrees(out["bias"][-1, 2])


for rate in (0.5, 1.5, 2.5):
    turned, bias = heading(rate)
    print(f"{rate} deg/s for 60 s: true {60 * rate:5.1f}, seen {turned:6.2f} deg, bias {bias:.2f} deg/s")
    if rate < 2:
        assert turned < 0.05 * 60 * rate and abs(bias - rate) < 0.01, "slow turns are seen now"
    else:
        assert abs(turned - 60 * rate) < 1, "faster turns are no longer seen"

turned, bias = heading(1.5, restBiasEstEnabled=False)
print(f"1.5 deg/s, restBiasEstEnabled=False: seen {turned:6.2f} deg, bias {bias:.2f} deg/s")
assert turned > 80, "the switch no longer brings the turn back"
EOF
