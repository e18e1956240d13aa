#!/usr/bin/env bash
# filterpy 2.0.0 (KalmanFilter.update with H=), beside 1.4.5.
# Expected: a measurement given as a plain vector, update([x, y], H=H), changes the state as
#   the column does, and the state keeps its shape (2, 1).
# Seen: in 2.0.0 the state becomes a (2, 2) matrix, without a word: each of its rows
#   is the whole right estimate, laid flat. Without H=, or in 1.4.5, it stays (2, 1).
# For gait: H= is the way to switch measurements on and off (zero velocity in stance), and
#   the later predictions run on with the matrix.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
cat > "$work/show.py" <<'EOF'
import sys
from importlib.metadata import version

import numpy as np
from filterpy.kalman import KalmanFilter


def state_after(measurement, **how):
    kf = KalmanFilter(dim_x=2, dim_z=2)
    kf.H = np.eye(2)
    kf.predict()
    kf.update(measurement, **how)
    return kf.x


vector = np.array([1.0, 2.0])
column = vector[:, None]
print("filterpy", version("filterpy"))
cases = {
    "vector": state_after(vector),
    "vector, H=": state_after(vector, H=np.eye(2)),
    "column, H=": state_after(column, H=np.eye(2)),
}
for name, x in cases.items():
    print(f"  {name:11s} state of shape {x.shape}: {x.round(3).tolist()}")
assert cases["vector"].shape == cases["column, H="].shape == (2, 1)
assert cases["vector, H="].shape == (2, int(sys.argv[1])), "the shape has changed"
EOF
python3 -m venv "$work/venv"
for case in '1.4.5 1' '2.0.0 2'; do
    read -r number columns <<< "$case"
    "$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile --no-deps \
        "filterpy==$number" numpy==2.2.6 scipy==1.15.3
    "$work/venv/bin/python" "$work/show.py" "$columns"
done
