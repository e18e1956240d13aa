"""The treadmill trials: parsing by files written here, belt and clocks by the real ones."""

import numpy as np
import pandas as pd
import pytest
from made.sets import loaded

from experiments.common.sets import tripod

RATE = 128.0
SECONDS, START, PERIOD = 150.0, 6.0, 1.2
CLOCK = 11.0  # OptoGait's clock is ahead of the sensors'


def swings(side):
    """Middles of the swings [s]; the stride times differ, or clocks could not be compared."""
    number = np.arange(105)
    return START + (0.6 if side == "left" else 0.0) + PERIOD * number + 0.05 * np.sin(1.7 * number**1.3)


def sensor(code, first=1):
    samples = round(SECONDS * RATE)
    time = (first + np.arange(samples)) / RATE
    table = np.zeros((samples, 14))
    table[:, 0] = np.round(time, 5)
    table[:, 5] = 1.0
    if code in ("LS", "RS"):
        side = "left" if code == "LS" else "right"
        rate = sum(np.exp(-0.5 * ((time - 1 / RATE - middle) / 0.08) ** 2) for middle in swings(side))
        table[:, 3] = np.rad2deg(5.0 * rate) * (-1 if side == "left" else 1)
    return table


def write_sensor(folder, code, table=None):
    (folder / "IMU").mkdir(parents=True, exist_ok=True)
    with (folder / "IMU" / f"{code}.csv").open("w", newline="") as stream:
        axes = [f"{kind} {axis}" for kind in ("Gyro", "Accel") for axis in "XYZ"]
        units = ["[s]", *["[deg/s]"] * 3, *["[g]"] * 3, *["[]"] * 7]
        stream.write("Gait Up - Physilog data export\n" + 4 * "header\n")
        stream.write(",".join(["Time", *axes, *map(str, range(7))]) + "\n" + ",".join(units) + "\n")
        pd.DataFrame(sensor(code) if table is None else table).to_csv(stream, index=False, header=False)


def write_optogait(folder):
    rows = [{"#": "External trigger", "L/R": "START"}]
    contacts = sorted(
        (middle + 0.19, side[0].upper(), k) for side in ("right", "left") for k, middle in enumerate(swings(side))
    )
    before = {}
    for time, side, k in contacts:
        cycle = time - before[side] if side in before else np.nan
        before[side] = time
        rows.append({"#": k, "L/R": side, "Split": time + CLOCK, "Stride": 130.0, "StrideTime\\Cycle": cycle,
                     "TStance": 0.8, "TSwing": cycle - 0.8})  # fmt: skip
    rows[41]["Stride"] = 20.0
    (folder / "OptoGait").mkdir(parents=True)
    pd.DataFrame(rows).to_csv(folder / "OptoGait" / "optogait.csv")


def write_zebris(folder):
    folder = folder / "Zebris" / "gait_report"
    folder.mkdir(parents=True)
    header = "type,Stride length, cm,Stride length SD, cm,Stance phase L, %,Velocity, km/h,Max gait line, cm/sec"
    (folder / "parameters.csv").write_text(
        f"\ufeff{header}\nparameter values,127.750,3.077,64.8,3.6,", encoding="utf-8"
    )


@pytest.fixture
def root(data_dir):
    return data_dir / "tripod" / "data" / "raw" / "TRIPOD"


@pytest.fixture
def folder(root):
    folder = root / "Sub_AB" / "PWS-20"
    for code in tripod.SENSORS:
        write_sensor(folder, code)
    write_optogait(folder)
    write_zebris(folder)
    return folder


def load():
    return loaded("tripod", "Sub_AB/PWS-20")[0]


def test_zebris_and_the_belt(folder):
    walk = load()
    zebris = {"stride_length": 1.2775, "stride_length_sd": 0.03077, "stance_fraction_left": 0.648, "speed": 1.0}
    assert walk.info["zebris"] == pytest.approx(zebris)
    assert walk.info["speed"] == pytest.approx(1.0) and walk.info["leg_length"] is None
    reference = walk.reference
    start, steady = walk.info["windows"]["whole"][0], walk.info["windows"]["steady"]
    assert start == pytest.approx(START * RATE, abs=2)
    assert steady == (start + 1280, start + 118 * 128)
    np.testing.assert_array_equal(np.flatnonzero(reference.valid), np.arange(*steady))
    np.testing.assert_allclose(np.diff(reference.distance)[start : steady[1] - 1], 1 / RATE, atol=1e-9)
    assert np.all(reference.distance[: start + 1] == 0) and np.all(np.diff(reference.distance)[steady[1] :] == 0)


# --- the real trials ---


@pytest.fixture(scope="module")
def walks(data):
    return data("tripod")


def test_belt_times_stride_time_is_zebris_and_optogaits_stride(walks):
    for walk in walks:
        if not walk.info["zebris"]:
            continue
        for side in ("right", "left"):
            of = walk.info["optogait"][side]
            kept = of["kept"]
            assert kept.sum() > 80
            by_belt = walk.info["speed"] * np.median(of["stride_time"][kept])
            assert by_belt == pytest.approx(walk.info["zebris"]["stride_length"], rel=0.015)
            assert np.median(of["stride_length"][kept]) == pytest.approx(by_belt, rel=0.025)
            assert np.median(of["stance_time"][kept] / of["stride_time"][kept]) == pytest.approx(0.7, abs=0.02)


def test_the_known_person_walks_at_the_published_speeds(walks):
    published = {"Sub_FZ/PWS": 3.7, "Sub_FZ/PWS+20": 4.4}
    for walk in walks:
        if walk.recording.name in published:
            assert walk.info["verified"] is True
            assert walk.info["speed"] * 3.6 == pytest.approx(published[walk.recording.name], abs=0.03)
