"""A walk that is known sample by sample, and files of measuring systems that hold it, written as their manuals say."""

import functools
from pathlib import Path

import numpy as np
import pandas as pd
from made.foot import foot

RATE = 100.0
G = 9.80665


@functools.cache
def walk():
    """Time [s], gyr [rad/s] and acc [m/s²] of a foot that walks, (T,) and (T, 3)."""
    imu = foot(strides=2, rest=1.0, hz=RATE, bias=(0.01, -0.02, 0.03)).recording.sensors["foot_right"]
    return imu.time, imu.gyr, imu.acc


def lines_of(separator, *columns):
    """Rows of text, a column an array; NaN is an empty cell."""
    cells = [["" if value != value else format(value, ".16g") for value in np.asarray(column)] for column in columns]
    return [separator.join(row) for row in zip(*cells, strict=True)]


def put(path, lines):
    """Write lines; the path."""
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return Path(path)


def mtw(path, *, packets=None, rate="100.0Hz", scale=1.0, keep=slice(None), separator="\t"):
    """Xsens MT Manager's text: rad/s, m/s²."""
    _, gyr, acc = walk()
    packets = np.arange(len(gyr)) if packets is None else packets
    names = ["PacketCounter", "SampleTimeFine", *(f"Acc_{a}" for a in "XYZ"), "FreeAcc_E", "FreeAcc_N", "FreeAcc_U",
             *(f"Gyr_{a}" for a in "XYZ"), *(f"Mag_{a}" for a in "XYZ"), *(f"Quat_q{k}" for k in range(4))]  # fmt: skip
    lost = np.full(len(gyr), np.nan)
    columns = [packets, lost, *acc.T, *(acc - [0, 0, G]).T, *(scale * gyr).T, *np.ones((7, len(gyr)))]
    head = ["// Start Time: Unknown", "// Update Rate: " + rate, "// Filter Profile: human (46.1)",
            "// Option Flags: AHS Disabled ICC Disabled ", "// Firmware Version: 4.3.4"]  # fmt: skip
    rows = lines_of(separator, *(np.asarray(column)[keep] for column in columns))
    return put(path, [*head, separator.join(names), *rows])


def dot(path, *, tag="Right foot", synced="Synced", start=0, stamps=True):
    """Movella DOT's exported CSV: deg/s, m/s², µs."""
    time, gyr, acc = walk()
    fine = (start + np.round(1e6 * time)) % 2**32 if stamps else np.full(len(time), np.nan)
    head = ["sep=,", f"DeviceTag:,{tag}", "FirmwareVersion:,2.0.0", "AppVersion:,v2021.2.0", f"SyncStatus:,{synced}",
            "OutputRate:,100Hz", "FilterProfile:,General", "Measurement Mode:,Custom Mode 1",
            "StartTime: ,2021-06-01_10:11:12", "© Xsens Technologies B. V. 2005-2021", ""]  # fmt: skip
    axes = [f"{name}_{axis}" for name in ("Euler", "FreeAcc", "Acc", "Gyr") for axis in "XYZ"]
    names = ["PacketCounter", "SampleTimeFine", *axes]
    columns = [1 + np.arange(len(time)), fine, *np.ones((3, len(time))), *(acc - [0, 0, G]).T, *acc.T]
    columns += [*np.rad2deg(gyr).T]
    return put(path, [*head, ",".join([*names, "Status"]), *lines_of(",", *columns, np.zeros(len(time)))])


def shimmer(path, *, devices=("Shimmer_8665",), kind="CAL", units=True, wide=None, separator="\t"):
    """Consensys' CSV: m/s², deg/s, Unix ms."""
    time, gyr, acc = walk()
    names, stated, columns = [], [], []
    for device in devices:
        names += [f"{device}_Timestamp_Unix_CAL", *(f"{device}_Accel_LN_{a}_{kind}" for a in "XYZ")]
        stated += ["ms", *["m/(s^2)"] * 3]
        # The low-noise accelerometer of a Shimmer 3 reaches 2 g.
        columns += [1.6e12 + 1e3 * time, *(acc if wide is None else np.clip(acc, -2 * G, 2 * G)).T]
        if wide is not None:
            names += [f"{device}_Accel_WR_{a}_CAL" for a in "XYZ"]
            stated += ["m/(s^2)"] * 3
            columns += [*wide.T]
        names += [f"{device}_Battery_CAL", *(f"{device}_Gyro_{a}_{kind}" for a in "XYZ")]
        stated += ["mV", *["deg/s"] * 3]
        columns += [np.full(len(time), 4000.0), *np.rad2deg(gyr).T]
    head = [f'"sep={separator}"'.replace("\t", "\\t"), separator.join(names)]
    rows = [*head[1:], *([separator.join(stated)] if units else []), *lines_of(separator, *columns)]
    return put(path, [head[0], *(row + separator for row in rows)])


XIO = [*(f"Gyroscope {a} (deg/s)" for a in "XYZ"), *(f"Accelerometer {a} (g)" for a in "XYZ")]


def xio(path, *, first="Timestamp (us)", scale=1e6, names=XIO, repeat=None):
    """x-io's CSV: deg/s, g."""
    time, gyr, acc = walk()
    stamps = np.arange(len(time)) if first == "Packet number" else scale * time
    lines = lines_of(",", stamps, *np.rad2deg(gyr).T, *(acc / G).T)
    if repeat is not None:
        lines.insert(repeat, lines[repeat])
    return put(path, [",".join([first, *names]), *lines])


def physilog(path, *, units=True, separator=","):
    """Gait Up's CSV: deg/s, g, s."""
    time, gyr, acc = walk()
    empty = np.full(len(time), np.nan)
    head = ["Gait Up - Physilog data export", "Created on: 2021-06-01 10:11:12", f"Total data points: {len(time)}", "",
            "Time [100 hz],Gyro [100 hz],,,Accel [100 hz],,,Baro [1 hz],,Event [100 hz]",
            "Time,Gyro X,Gyro Y,Gyro Z,Accel X,Accel Y,Accel Z,Pressure,Temperature,"]  # fmt: skip
    stated = ["[s],[deg/s],[deg/s],[deg/s],[g],[g],[g],[mBar],[degree C],"] if units else []
    lines = lines_of(",", 0.01 + time, *np.rad2deg(gyr).T, *(acc / G).T, empty, empty)
    lines = [*head, *stated, *(line + "," for line in lines)]
    return put(path, [line.replace(",", separator) for line in lines])


def named(path, *, prefix="foot_right_", time=True, degrees=True):
    """jgait's own columns."""
    stamps, gyr, acc = walk()
    names = [*(f"{prefix}gyr_{a}" for a in "xyz"), *(f"{prefix}acc_{a}" for a in "xyz")]
    columns = [*(np.rad2deg(gyr) if degrees else gyr).T, *acc.T]
    head, own = (["time"], [stamps]) if time else ([], [])
    return put(path, [",".join([*head, *names]), *lines_of(",", *own, *columns)])


def frame(sign=1.0):
    """The walk as a table with gaitmap's and mobgap's names, m/s² and deg/s; the rates times a sign."""
    _, gyr, acc = walk()
    names = [f"{kind}_{axis}" for kind in ("acc", "gyr") for axis in "xyz"]
    return pd.DataFrame(np.hstack([acc, np.rad2deg(sign * gyr)]), columns=names)


def check(recording, placement="foot_right", rows=slice(None), atol=1e-7):
    """The recording is the known walk, sample by sample."""
    time, gyr, acc = walk()
    imu = recording.sensors[placement]
    assert len(imu.time) == len(time[rows])
    np.testing.assert_allclose(imu.time, time[rows] - time[rows][0], atol=2e-6)
    kept = np.asarray(imu.mask)
    np.testing.assert_allclose(imu.gyr[kept], gyr[rows][kept], atol=atol)
    np.testing.assert_allclose(imu.acc[kept], acc[rows][kept], atol=atol)
    return kept
