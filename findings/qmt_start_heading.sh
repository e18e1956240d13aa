#!/usr/bin/env bash
# qmt 0.2.4 (oriEstMadgwick, oriEstMahony beside oriEstVQF), no magnetometer.
# Expected: the three filters take the same arguments and give the same convention, so a
#   sensor that tilts by 5 degrees and does not turn starts at the same heading in all.
# Seen: VQF starts at 0 degrees, Madgwick and Mahony at 90, and without a magnetometer they stay
#   there. The inclination agrees to a tenth of a degree.
# For gait: joint angles between a foot by one filter and a shank by another are a
#   quarter turn off, and walking directions differ.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    --no-deps qmt==0.2.4 vqf==2.1.2 aiofiles==25.1.0 orjson==3.13.0 numpy==2.2.6 scipy==1.15.3

"$work/venv/bin/python" - <<'EOF'
import numpy as np
import qmt

n, tilt = 1000, np.radians(5)
gyr = np.zeros((n, 3))
acc = np.tile([0.0, 9.81 * np.sin(tilt), 9.81 * np.cos(tilt)], (n, 1))

for name, expected in (("oriEstVQF", 0), ("oriEstMadgwick", 90), ("oriEstMahony", 90)):
    q = np.asarray(getattr(qmt, name)(gyr, acc, params={"Ts": 0.01}))
    w, x, y, z = q.T
    heading = np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    inclination = np.degrees(2 * np.arccos(np.hypot(w, z)))
    print(f"{name:15s} heading {heading[0]:6.2f} deg at the start, {heading[-1]:6.2f} at the end,",
          f"inclination {inclination[-1]:.3f} deg")
    assert abs(heading[0] - expected) < 0.5 and abs(heading[-1] - expected) < 0.5
    assert abs(inclination[-1] - 5) < 0.1
EOF
