"""What gaitmap and mobgap say of jgait's tables, and of data in their frames, in environments of their own."""

import subprocess

import numpy as np
import pandas as pd
import pytest
from made import files as made_files
from made import tables as made_tables

from jgait import io

RATE = made_tables.RATE
PAUSE = 4.0


@pytest.fixture(scope="module")
def ask(load_experiment, tmp_path_factory):
    """`ask("gaitmap", tables, script)`: the folder in which a library has run a script on tables, as CSV files."""

    def asked(name, tables, script):
        peers = load_experiment("common.peers")
        if not peers.available(name):
            pytest.skip(peers.unavailable_reason(name))
        folder = tmp_path_factory.mktemp(name)
        for file, table in tables.items():
            io.write_table(table, folder / f"{file}.csv")
        command = [peers.python(name), "-E", "-s", "-c", script]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
        return folder

    return asked


GAITMAP = f"""
import pandas as pd
from gaitmap.parameters import SpatialParameterCalculation, TemporalParameterCalculation
from gaitmap.utils.coordinate_conversion import convert_to_fbf
from gaitmap.utils.datatype_helper import is_sensor_data, is_stride_list
from gaitmap.utils.stride_list_conversion import enforce_stride_list_consistency

data = pd.read_csv("sensor.csv", header=[0, 1], index_col=0)
assert is_sensor_data(data, frame="sensor") == "multi"
body = convert_to_fbf(data, left=["left_sensor"], right=["right_sensor"])
assert is_sensor_data(body, frame="body") == "multi"
body.to_csv("body.csv")

SENSORS = ("right_sensor", "left_sensor")
def by_sensor(name, index):
    whole = pd.read_csv(name)
    return {{sensor: whole[whole.sensor == sensor].drop(columns="sensor").set_index(index) for sensor in SENSORS}}
strides = by_sensor("strides.csv", "s_id")
assert is_stride_list(strides, stride_type="min_vel") == "multi"
for own in strides.values():
    kept, lost = enforce_stride_list_consistency(own.reset_index(), "min_vel")
    assert len(lost) == 0 and len(kept) == len(own) > 0
times = TemporalParameterCalculation().calculate(strides, {RATE}).parameters_
spaces = SpatialParameterCalculation().calculate(
    strides, by_sensor("positions.csv", ["s_id", "sample"]), by_sensor("orientations.csv", ["s_id", "sample"]),
    {RATE},
).parameters_
for sensor in SENSORS:
    times[sensor].join(spaces[sensor]).to_csv(sensor + ".csv")
"""


def trajectories(lists):
    """Positions and orientations of each stride, as gaitmap has them: from its first sample to one after its last."""
    tables = {"positions": [], "orientations": []}
    for side, (sensor, own) in enumerate(lists.items()):
        for stride, row in own.iterrows():
            samples = np.arange(row["start"], row["end"] + 1)
            at = made_tables.track(side, samples / RATE)
            index = {"sensor": sensor, "s_id": stride, "sample": samples - samples[0]}
            # The way itself is straight; only the foot's heading turns.
            place = {"pos_x": at.along, "pos_y": np.zeros(len(samples)), "pos_z": at.up}
            tables["positions"].append(pd.DataFrame({**index, **place}))
            # Heading about z, then pitch about -y, for toes up is positive; w last.
            (cz, sz), (cy, sy) = ((np.cos(angle / 2), np.sin(angle / 2)) for angle in (at.heading, -at.pitch))
            turn = {"q_x": -sz * sy, "q_y": cz * sy, "q_z": sz * cy, "q_w": cz * cy}
            tables["orientations"].append(pd.DataFrame({**index, **turn}))
    return {name: pd.concat(parts) for name, parts in tables.items()}


@pytest.fixture(scope="module")
def gaitmap(ask, tmp_path_factory):
    both = pd.concat({"right_sensor": made_files.frame(), "left_sensor": made_files.frame(-1.0)}, axis=1)
    sensor = tmp_path_factory.mktemp("walk") / "sensor.csv"
    both.to_csv(sensor)
    lists = io.to_gaitmap(made_tables.estimate(), RATE)
    return ask("gaitmap", {"strides": lists, **trajectories(lists)}, GAITMAP.replace("sensor.csv", str(sensor)))


def test_gaitmap_finds_the_same_parameters_in_the_same_walk(gaitmap):
    found = io.to_gaitmap_parameters(made_tables.estimate(), RATE)
    for sensor, mine in found.items():
        theirs = pd.read_csv(gaitmap / f"{sensor}.csv", index_col="s_id")
        assert list(theirs.index) == list(mine.index)
        assert set(mine.columns) <= set(theirs.columns)
        # gaitmap's events are whole samples: half a sample of 0.01 s, of a pitch that turns by 0.05 rad meanwhile.
        for name, within in (("stride_length", 1e-7), ("turning_angle", 1e-5), ("max_sensor_lift", 1e-3),
                             ("stride_time", 0.011), ("swing_time", 0.011), ("stance_time", 0.011),
                             ("gait_velocity", 0.012), ("ic_angle", 2.0), ("tc_angle", 2.0)):  # fmt: skip
            np.testing.assert_allclose(mine[name], theirs[name], atol=within, err_msg=f"{sensor} {name}")


def test_gaitmaps_body_frame_is_turned_back(gaitmap):
    body = pd.read_csv(gaitmap / "body.csv", header=[0, 1], index_col=0)
    assert set(body["left_sensor"]) == {f"{kind}_{axis}" for kind in ("acc", "gyr") for axis in ("pa", "ml", "si")}
    read = io.read(gaitmap / "body.csv", sampling_rate_hz=100.0)
    for recording in (io.recording_from_gaitmap(body, 100.0), read):
        made_files.check(recording)
        np.testing.assert_allclose(recording.sensors["foot_left"].gyr, -made_files.walk()[1], atol=1e-9)


MOBGAP = f"""
import pandas as pd
from mobgap.laterality import strides_list_from_ic_lr_list
from mobgap.utils.conversions import to_body_frame
from mobgap.wba import WbAssembly

to_body_frame(pd.read_csv("sensor.csv")).to_csv("body.csv", index=False)
contacts = pd.read_csv("ic_list.csv").set_index("step_id")
strides_list_from_ic_lr_list(contacts).to_csv("from_contacts.csv")
strides = pd.read_csv("per_stride_parameters.csv").set_index(["wb_id", "s_id"]).reset_index("wb_id", drop=True)
found = WbAssembly().assemble(strides, raw_initial_contacts=contacts, sampling_rate_hz={RATE})
bouts = found.wb_meta_parameters_.drop(columns=["rule_name", "rule_obj"])
means = found.annotated_stride_list_[["stride_duration_s", "cadence_spm", "stride_length_m", "walking_speed_mps"]]
bouts.join(means.groupby("wb_id").mean()).to_csv("bouts.csv")
"""


@pytest.fixture(scope="module")
def mobgap(ask):
    tables = io.to_mobgap(made_tables.estimate(PAUSE), RATE)._asdict()
    return ask("mobgap", {"sensor": made_files.frame(), **tables}, MOBGAP)


def test_mobgap_makes_the_same_strides_of_the_contacts(mobgap):
    theirs = pd.read_csv(mobgap / "from_contacts.csv")
    # It makes a stride of the pause, too: one of each foot.
    lasts = theirs["end"] - theirs["start"]
    assert (lasts > 3 * RATE).sum() == 2
    mine = io.to_mobgap(made_tables.estimate(PAUSE), RATE).per_stride_parameters
    np.testing.assert_array_equal(
        theirs[lasts < 3 * RATE][["start", "end", "lr_label"]].to_numpy(), mine[["start", "end", "lr_label"]].to_numpy()
    )


def test_mobgap_assembles_the_same_bouts(mobgap):
    theirs = pd.read_csv(mobgap / "bouts.csv", index_col="wb_id")
    mine = io.to_mobgap(made_tables.estimate(PAUSE), RATE).per_wb_parameters
    assert len(theirs) == len(mine) == 2 and set(mine.columns) == set(theirs.columns)
    for name in mine.columns:
        np.testing.assert_allclose(mine[name], theirs[name], rtol=1e-9, err_msg=name)


def test_mobgaps_body_frame_has_other_names_only(mobgap):
    made_files.check(io.read(mobgap / "body.csv", sampling_rate_hz=100.0), "lower_back")
