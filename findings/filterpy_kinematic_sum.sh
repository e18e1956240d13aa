#!/usr/bin/env bash
# filterpy 2.0.0 (filterpy.common.kinematic_kf).
# Expected: kinematic_kf(dim=2, order=1), a constant velocity model of the plane, measures x and y.
# Seen: its H is one row, [1 0 1 0]: it measures the sum x + y, as dim_z is 1 by default whatever
#   dim is. Fed with 3 + 1 = 4 only, it splits the sum into x = y = 2. dim_z=2 doubles the row.
#   Version 1.4.5 gives the two rows for the same call.
# For gait: a walker's path in the plane (video, radio anchors) is bent onto the diagonal.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    --no-deps filterpy==2.0.0 numpy==2.2.6 scipy==1.15.3

"$work/venv/bin/python" - <<'EOF'
import numpy as np
from filterpy.common import kinematic_kf

kf = kinematic_kf(2, 1)
print("kinematic_kf(2, 1).H          =", kf.H.tolist())
print("state", kf.x.shape[0], "numbers, measurement", kf.dim_z)
for _ in range(500):  # a walker who stands at x = 3, y = 1
    kf.predict()
    kf.update(4.0)
x, y = kf.x[0, 0], kf.x[2, 0]
print(f"fed with the sum 4.0 it finds x = {x:.2f}, y = {y:.2f} for 3, 1")

doubled = kinematic_kf(2, 1, dim_z=2)
print("kinematic_kf(2, 1, dim_z=2).H =", np.asarray(doubled.H).tolist())
assert kf.H.tolist() == [[1.0, 0.0, 1.0, 0.0]], "the default measures something else now"
assert np.asarray(doubled.H).tolist() == 2 * kf.H.tolist(), "dim_z=2 has changed"
assert abs(x - 2) < 0.05 and abs(y - 2) < 0.05
EOF
