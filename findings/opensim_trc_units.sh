#!/usr/bin/env bash
# OpenSim 4.6 and its .trc files of marker positions.
# Expected: Units=mm in the header means the same to every reader, and DataRate agrees with the times.
# Seen: one file with a marker at 1000 mm gives 1000 by TimeSeriesTableVec3 and MarkerData, and 1.0
#   (metres) by MarkersReference. With DataRate=50 over times 0.01 s apart nothing
#   is said: MarkersReference reports 50 Hz, the table's times say 100 Hz.
# For gait: a script that reads markers from the table and compares them with a model in metres
#   is wrong by 1000, unless it reads the Units entry of the table's metadata itself.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    --no-deps opensim==4.6 numpy==2.2.6

"$work/venv/bin/python" - <<'EOF'
import os
import tempfile

import opensim

opensim.Logger.setLevelString("off")


def trc(folder, units, rate):
    """Write three frames, 0.01 s apart, of one marker that stands at x = 1000."""
    path = os.path.join(folder, f"{units}_{rate}.trc")
    lines = [
        "PathFileType\t4\t(X/Y/Z)\tmarkers.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t3\t1\t{units}\t{rate}\t1\t3",
        "Frame#\tTime\tHEEL\t\t",
        "\t\tX1\tY1\tZ1",
        "",
    ]
    lines += [f"{i + 1}\t{i / 100:.2f}\t1000\t100\t0" for i in range(3)]
    with open(path, "w", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")
    return path


weights = opensim.SetMarkerWeights()
weights.cloneAndAppend(opensim.MarkerWeight("HEEL", 1.0))
with tempfile.TemporaryDirectory() as folder:
    for units, rate, metres in (("mm", 100, 1.0), ("m", 100, 1000.0), ("mm", 50, 1.0)):
        path = trc(folder, units, rate)
        table = opensim.TimeSeriesTableVec3(path)
        markers = opensim.MarkerData(path)
        reference = opensim.MarkersReference(path, weights)
        x_table = table.getRowAtIndex(0)[0][0]
        x_markers = markers.getFrame(0).getMarker(0)[0]
        x_reference = reference.getMarkerTable().getRowAtIndex(0)[0][0]
        step = table.getIndependentColumn()[1] - table.getIndependentColumn()[0]
        said = reference.getSamplingFrequency()
        print(f"Units={units:2s} DataRate={rate:3d}: table {x_table:6.1f}, MarkerData {x_markers:6.1f},",
              f"MarkersReference {x_reference:6.1f}; {said:.0f} Hz said, {1 / step:.0f} Hz by the times")
        assert x_table == x_markers == 1000 and x_reference == metres
        assert said == rate and abs(step - 0.01) < 1e-9
EOF
