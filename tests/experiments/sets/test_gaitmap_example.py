"""Shoes and motion capture: parsing by files written here, alignment and strides by the real ones."""

import numpy as np
import pandas as pd
import pytest
from made.notes import texts
from made.sets import loaded

from jgait import datasets
from jgait.commands import cohort

RATE, MOCAP = 204.8, 100.0
SECONDS, PERIOD, LENGTH, WIDTH = 13.0, 1.0, 1.2, 0.14
FEET = {"left": (WIDTH / 2, 0.0), "right": (-WIDTH / 2, 0.5)}  # [m] to the left, [s] later


def heel(side, time):
    """Ten strides along +y, each in the second half of its period: the left foot's first ends at 2 s."""
    lateral, late = FEET[side]
    phase = np.clip(time - 1.0 - late, 0.0, 10.0)
    swing = np.clip(2 * (phase % PERIOD) - 1, 0, 1)
    return np.stack([-lateral + 0 * time, LENGTH * (phase // PERIOD + swing), 0.05 + 0 * time], axis=1)


def sensor_table(order):
    time = np.arange(round(SECONDS * RATE)) / RATE
    columns = {
        (f"{side}_sensor", f"{kind}_{axis}"): {"gyr": 90.0, "acc": 9.81}[kind] * (axis == "z") + 0 * time
        for side, kind, axis in order
    }
    table = pd.DataFrame(columns)
    table.columns = pd.MultiIndex.from_tuples(table.columns, names=["sensor", "axis"])
    return table


ORDER = [(side, kind, axis) for kind in ("acc", "gyr") for axis in "xyz" for side in ("left", "right")]


@pytest.fixture
def folder(data_dir):
    folder = data_dir / "gaitmap_example" / "example_data"
    folder.mkdir(parents=True)
    sensor_table(ORDER).to_csv(folder / "imu_sample_new.csv")
    return folder


def written(folder, monkeypatch):
    """The main walk's files with other content, under a registry that does not know them."""
    known = datasets.info("gaitmap_example")._replace(files={})
    monkeypatch.setattr(datasets.registry, "info", lambda _: known)
    sensor_table(ORDER).to_csv(folder / "imu_sample.csv")
    time = np.arange(round(SECONDS * MOCAP)) / MOCAP
    markers = {}
    for side in FEET:
        letter = side[0].upper()
        for marker, ahead, out in (("FCC", 0.0, 0.0), ("TOE", 0.24, 0.03), ("FM5", 0.17, 0.07)):
            sign = -1 if side == "left" else 1
            position = heel(side, time) + [sign * out, ahead, 0]
            markers |= {(f"{letter}_{marker}", axis): 1000 * position[:, k] for k, axis in enumerate("xyz")}
    pd.DataFrame(markers).to_csv(folder / "mocap_sample.csv")
    rows = []
    for side, (_, late) in FEET.items():
        for k in range(1, 9):
            ic = 1.0 + late + k * PERIOD
            stride = {"pre_ic": ic, "start": ic + 0.2, "tc": ic + 0.6, "ic": ic + 1.0, "end": ic + 1.2}
            rows.append({"s_id": len(rows), "foot": side, "min_vel": (ic + 0.2) * RATE}
                        | {key: value * RATE for key, value in stride.items()})  # fmt: skip
    pd.DataFrame(rows).to_csv(folder / "stride_events_sample.csv", index=False)
    borders = [{"s_id": 0, "foot": "left", "start": 10, "end": 20, "gsd_id": 1}]
    pd.DataFrame(borders).to_csv(folder / "stride_borders_sample.csv", index=False)
    return loaded("gaitmap_example", "imu_sample")


def test_strides_from_the_markers(folder, monkeypatch):
    (walk,) = written(folder, monkeypatch)
    for side in ("right", "left"):
        strides = walk.info["strides"][side]
        np.testing.assert_allclose(strides["length"], LENGTH, atol=1e-9)
        np.testing.assert_allclose(strides["width"][~np.isnan(strides["width"])], WIDTH, atol=1e-9)
        np.testing.assert_allclose(strides["width_toe"][~np.isnan(strides["width"])], WIDTH + 0.06, atol=1e-9)
        assert np.isfinite(strides["width"]).sum() >= 7
        np.testing.assert_allclose(strides["time"], PERIOD)
        np.testing.assert_allclose(strides["stance_fraction"], 0.6)
        assert strides["straight"].all()
    assert walk.reference.distance[-1] == pytest.approx(10 * LENGTH, abs=0.01)
    assert walk.info["stride_borders"]["left"].tolist() == [[10, 20]]
    np.testing.assert_allclose(walk.info["mocap"]["left"]["heel"], heel("left", walk.info["mocap_time"]), atol=1e-9)


def test_the_same_walk_in_other_axes_counts_once(folder, monkeypatch):
    written(folder, monkeypatch)
    both = ["imu_sample", "imu_sample_not_rotated"]
    assert datasets.repeated("gaitmap_example") == {}
    sensor_table(ORDER).to_csv(folder / "imu_sample_not_rotated.csv")
    assert datasets.repeated("gaitmap_example") == {both[1]: both[0]}
    assert [walk.recording.name for walk in datasets.load("gaitmap_example")] == ["imu_sample", "imu_sample_new"]
    assert [walk.recording.name for walk in datasets.load("gaitmap_example", both)] == both
    source = cohort.source(None, "gaitmap_example", None, 0, None, None, ())
    assert source.items == ["imu_sample", "imu_sample_new"] and list(source.marks) == source.items
    assert texts(source.notes) == ["imu_sample_not_rotated is left out: it is the same walk as imu_sample"]
    (folder / "imu_sample.csv").unlink()
    assert [walk.recording.name for walk in datasets.load("gaitmap_example")] == ["imu_sample_new", both[1]]


# --- the real files ---


@pytest.fixture(scope="module")
def walk(data):
    return data("gaitmap_example", "imu_sample")[0]


def test_the_main_walk_is_twice_twenty_metres(walk):
    assert walk.info["verified"] is True
    assert walk.reference.distance[-1] == pytest.approx(40.65, abs=0.15)
    lengths = np.concatenate([of["length"][of["straight"]] for of in walk.info["strides"].values()])
    assert len(lengths) == 55, "28 and 29 strides without one turn each"
    assert np.percentile(lengths, 5) > 1.28 and np.percentile(lengths, 95) < 1.46
    for side in ("right", "left"):
        toes = walk.info["strides"][side]["width_toe"]
        assert np.nanmedian(toes) == pytest.approx(0.11, abs=0.01)
