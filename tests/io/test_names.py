"""A lab's own words for columns."""

import numpy as np
import pandas as pd
import pytest
from made.frames import table
from made.notes import texts

from jgait import io
from jgait.io.names import column_of, lettered, placement_of
from jgait.types import RecordingError

KNOWN = {
    "thigh_right": ("GyroThighR_x", "Gyro Thigh R X [deg/s]", "thighRightGyrX"),
    "thigh_right_acc": ("muslo_derecho_acc_x", "Oberschenkel_rechts_Beschleunigung_x"),
    "foot_left": ("LFoot.Gyro.X", "foot_L_5_gyr_x", "LF_gyro_x_rads", "Pied Gauche Gyro X",
                  "piede sinistro giroscopio x"),
    "lower_back": ("L5 Gyr_X", "Lumbar Gyro X", "lowerback gyrx"),
    "lower_back_acc": ("L5_Acc_X", "l4AccX"),
    "pelvis": ("Kreuzbein_Drehrate_x",),
    "shank_left": ("GyroUnterschenkelLinks_x", "shank_l_gyr_x"),
    "shank_right_acc": ("pierna derecha Aceleración X",),
    "ankle_right": ("Knöchel re Gyr X",),
    "foot_left_acc": ("Foot Accel Sensor X LT (mG)", "Fuß_li_acc_x"),
    "": ("gyrX", "Gyr_X", "gx", "wx (rad/s)", "Gyro-X (d/s)"),
    "_acc": ("ax", "gFx"),
    None: ("", "Date", "Quat_x", "mag_x", "Temp", "Packet counter", "FreeAcc_X", "Pelvis Linear Acceleration X",
           "tigh_right_gyr_x", "thigh_gyr_x", "gyr", "heart rate", "thigh_right_gyr"),
    "time": ("Time (ms)", "time_us", "timestamp", "Zeit_s", "t_ms", "Datetime", "Date Time", "Datum_Uhrzeit"),
}  # fmt: skip
"""Sensor, and its signal if that is none of the gyroscope → ways to write the name of its x axis."""


@pytest.mark.parametrize(("known", "name"), [(known, name) for known, names in KNOWN.items() for name in names])
def test_words_of_a_column_give_its_placement(known, name):
    kind = "" if str(known).endswith("_acc") else "_gyr"
    assert column_of(name) == (known if known in (None, "time") else f"{known}{kind}_x".removeprefix("_"))


def test_numbers_of_axes_are_letters_and_numbers_of_sensors_stay():
    axes = [f"Foot L Acc {number} [g]" for number in (1, 2, 3)]
    assert lettered(["time", *axes]) == ["time", *(f"Foot L Acc_{axis} [g]" for axis in "xyz")]
    for names in ([f"acc_{n}_{axis}" for n in (1, 2, 3) for axis in "xyz"], [f"gyr_x{n}" for n in (1, 2, 3)],
                  [f"gyr_{n}" for n in (1, 2, 3, 4)], ["emg_1", "emg_2", "emg_3"]):  # fmt: skip
        assert lettered(names) == names


PLACES = {
    "foot_left": ("LF", "LFootSensor2"), "foot_right": ("12_rf", "rightfoot"), "shank_left": ("shankl1",),
    "shank_right": ("RS", "right_lower_leg", "tibia_r_imu"), "thigh_right": ("Upper Leg R",), "pelvis": ("SA",),
    "lower_back": ("1-1_lb", "walk_L5", "lower right back"), "waist": ("Hips",), "head": ("forehead",),
    None: ("trial5", "00B40C48", "data", "elf", "Upper Back", "upperback_imu", "Right Upper Arm", "Chip1", "foot",
           "barefoot_right", "backpack", "relationship", "left foot right"),
}  # fmt: skip
"""Placement → names of sensors; a word within a word is no placement."""


@pytest.mark.parametrize(("placement", "name"), [(place, name) for place, names in PLACES.items() for name in names])
def test_names_of_sensors_give_a_placement(placement, name):
    assert placement_of(name) == placement


def walking(names):
    """A table of one shank whose columns turn as in walking."""
    time = np.arange(200) / 50.0
    return pd.DataFrame({name: 200.0 * np.sin(6.0 * time + k) for k, name in enumerate(names)}).assign(time=time)


def test_placements_taken_from_names_are_noted():
    recording = io.recording_from_dataframe(walking(["Gyro Shank R X", "Gyro Shank R Y", "Gyro Shank R Z", "Mag X"]))
    assert list(recording.sensors) == ["shank_right"]
    (told,) = (note for note in texts(recording.notes) if "recognised by their names" in note)
    assert "'Gyro Shank R Y' as shank_right_gyr_y" in told
    assert "columns left out: Mag X" in texts(recording.notes)


def test_a_sensor_is_placed_by_its_own_name_also_where_its_columns_are_recognised(tmp_path):
    walking([f"FussRechts_Gyro_{axis} [deg/s]" for axis in "XYZ"]).to_csv(tmp_path / "walk.csv", index=False)
    for place in ("foot_right", "shank_right"):
        assert list(io.read(tmp_path / "walk.csv", placements={"FussRechts": place}).sensors) == [place]


def test_a_bare_g_is_a_rate_only_beside_an_acceleration(tmp_path):
    names = ["gx", "gy", "gz"]
    whole = walking(names).assign(ax=9.8, ay=0.0, az=0.0)
    assert io.recording_from_dataframe(whole, placement="shank_right").sensors["shank_right"].acc is not None
    with pytest.raises(RecordingError, match="no column that is recognised"):
        io.recording_from_dataframe(walking(names), placement="shank_right")
    walking(names).to_csv(tmp_path / "walk.csv", header=False, index=False)
    with pytest.raises(RecordingError, match="has no header: it begins with"):
        io.read_csv(tmp_path / "walk.csv")


def test_lines_of_facts_above_a_header_in_unknown_words_are_passed_over(tmp_path):
    rows = walking(["Foot Gyroscope X LT", "Foot Gyroscope Y LT", "Foot Gyroscope Z LT"]).to_csv(index=False)
    (tmp_path / "walk.csv").write_text(f"Type,Ultium\nFrequency,100.0\n{rows}")
    assert list(io.read_csv(tmp_path / "walk.csv").sensors) == ["foot_left"]


def test_columns_of_a_sensor_without_a_known_place_are_no_small_matter():
    names = [f"Shank {side} Gyro {axis}" for side in ("R", "Lft") for axis in "XYZ"]
    notes = io.recording_from_dataframe(walking([*names, "Mag X"])).notes
    (told,) = (note for note in notes if note.code == "signals_left_out")
    assert told.severity == "check" and "no place that is known: Shank Lft Gyro X, Shank Lft Gyro Y" in told.text
    assert "columns left out: Mag X" in texts(notes)


SHANK = [f"RShank_{kind}_{axis}" for kind in ("Gyro", "Accel") for axis in "XYZ"]


@pytest.mark.parametrize(
    ("names", "said", "never"),
    [
        (["Gyro Shank R X", "Gyr Shank R X", "Gyro Shank R Y", "Gyro Shank R Z"], "lacks shank_right_gyr_x", "\n"),
        ([name.replace("RShank_Gyro_Y", "RShnak_Gyro_Y") for name in SHANK],
         "lacks shank_right_gyr_y; 'RShnak_Gyro_Y' looks like 'shank_right_gyr_y'", "'RShank_Gyro"),
        (["RShank_Gyro_X", "RShank_Gyro_Z", "Quat_W"], "lacks shank_right_gyr_y", "looks like"),
    ],
    ids=["two with the same words", "misspelt", "not there"],
)  # fmt: skip
def test_a_column_that_is_lacking_is_named_with_one_that_may_be_meant(names, said, never):
    with pytest.raises(RecordingError) as caught:
        io.recording_from_dataframe(walking(names))
    assert said in str(caught.value) and never not in str(caught.value)


@pytest.mark.parametrize("values", [("left_foot", "right_foot"), ("L", "R"), (1, 2), ("A17", "B03")])
@pytest.mark.parametrize("mixed", [True, False])
def test_a_row_for_each_sensor_is_refused_with_the_column_that_states_it(tmp_path, values, mixed):
    frames = [walking(["gyr_x", "gyr_y", "gyr_z"]).assign(device=value) for value in values]
    frame = pd.concat(frames)
    frame = frame.sort_values("time", kind="stable") if mixed else frame
    frame.to_csv(tmp_path / "walk.csv", index=False)
    said = (
        rf"row for each sensor, which its column 'device' states \({values[0]}, {values[1]}\): write the rows of each"
    )
    for read, options in ((io.read, {}), (io.read_csv, {}), (io.read_csv, {"placement": "waist"})):
        with pytest.raises(RecordingError, match=said):
            read(tmp_path / "walk.csv", **options)
    alone = walking(["gyr_x", "gyr_y", "gyr_z"]).assign(device=values[0], activity=["stand", "walk"] * 100)
    assert io.recording_from_dataframe(alone, placement="shank_right")


def test_names_that_are_not_recognised_are_named_where_the_gyroscope_lacks():
    frame = table().rename(columns={f"shank_right_gyr_{axis}": f"shank_right_gyr_{axis}_rev" for axis in "xyz"})
    with pytest.raises(
        RecordingError, match="lacks shank_right_gyr_x.*needs its gyroscope.*not recognised: 'shank_right_gyr_x_rev', "
    ):
        io.recording_from_dataframe(frame)
