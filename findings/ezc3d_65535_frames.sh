#!/usr/bin/env bash
# ezc3d 1.7.2 and captures of more than 65 535 frames (5 min 28 s at 200 Hz), also as Kinetics Toolkit 0.17.0 reads them.
# Expected: a file that ezc3d writes from 70 000 frames is read back with 70 000 frames, or an error or a warning says
#   that frames are missing. The header of C3D has 16 bits for the last frame; TRIAL:ACTUAL_END_FIELD has 32.
# Seen: the file holds all 70 000 frames (its size shows it), yet ezc3d reads 65 535 of them, with and without
#   TRIAL:ACTUAL_END_FIELD, and says nothing. Kinetics Toolkit hands on the same 65 535 frames; its one warning is on units.
# For gait: a walk of six minutes at 200 Hz loses its last 22 s, and with them distance and strides.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile ezc3d==1.7.2 kineticstoolkit==0.17.0

WORK="$work" "$work/venv/bin/python" - <<'EOF2'
import os
import warnings

import ezc3d
import kineticstoolkit
import numpy as np

FRAMES = 70_000


def written(name, fields):
    """A file of one marker that moves 0.1 mm a frame, with or without the number of its last frame in 32 bits."""
    path = os.path.join(os.environ["WORK"], name)
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [200.0]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = ("HEEL",)
    points = np.ones((4, 1, FRAMES))
    points[0, 0] = np.arange(FRAMES) / 10
    file["data"]["points"] = points
    if fields:
        file.add_parameter("TRIAL", "ACTUAL_START_FIELD", [1, 0])
        file.add_parameter("TRIAL", "ACTUAL_END_FIELD", [FRAMES % 65_536, FRAMES // 65_536])
    file.write(path)
    assert os.path.getsize(path) >= 16 * FRAMES  # four numbers of 4 bytes a frame
    return path


for fields in (False, True):
    path = written(f"long_{fields}.c3d", fields)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        back = ezc3d.c3d(path)["data"]["points"]
    assert not said, [str(one.message) for one in said]
    print(f"TRIAL:ACTUAL_END_FIELD {fields}: {FRAMES} frames written, {back.shape[2]} read, last x {back[0, 0, -1]:.1f} mm")
    assert back.shape[2] == 65_535
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        series = kineticstoolkit.read_c3d(path)["Points"]
    assert len(series.time) == 65_535
    assert not any("frame" in str(one.message).lower() for one in said)
EOF2
