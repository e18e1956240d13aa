#!/usr/bin/env bash
# vqf 2.1.2 into scipy 1.15.3 (scipy.spatial.transform.Rotation).
# Expected: a quaternion from an orientation filter means the same rotation to SciPy.
# Seen: vqf gives w, x, y, z; Rotation.from_quat reads x, y, z, w. A level sensor at rest
#   becomes a half turn about x, and a turn to the left becomes something else: the
#   norm is 1 either way, so nothing is refused. scalar_first=True is right; SciPy has
#   it since 1.14.
# For gait: foot pitch and gravity point the wrong way in every downstream step.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    vqf==2.1.2 numpy==2.2.6 scipy==1.15.3

"$work/venv/bin/python" - <<'EOF'
import numpy as np
from scipy.spatial.transform import Rotation
from vqf import VQF

n = 300
gyr = np.zeros((n, 3))
gyr[100:200, 2] = np.pi / 2  # 90 degrees to the left in one second
acc = np.tile([0.0, 0.0, 9.81], (n, 1))
q = VQF(0.01).updateBatch(gyr, acc)["quat6D"]
print("vqf at rest:", q[50].round(3), " after the turn:", q[-1].round(3))

plain = Rotation.from_quat(q[[50, -1]])
right = Rotation.from_quat(q[[50, -1]], scalar_first=True)
up = np.array([0.0, 0.0, 1.0])
print("sensor's up axis in the world, as is:        ", plain.apply(up).round(3).tolist())
print("sensor's up axis in the world, scalar first: ", right.apply(up).round(3).tolist())
print("angle of the first rotation: as is", np.degrees(plain.magnitude()[0]).round(1),
      "deg, scalar first", np.degrees(right.magnitude()[0]).round(1), "deg")

assert np.allclose(right.apply(up), up, atol=1e-6)
assert abs(np.degrees((right[1] * right[0].inv()).magnitude()) - 90) < 0.5
assert np.allclose(plain[0].apply(up), -up, atol=1e-6), "from_quat reads the scalar first now"
EOF
