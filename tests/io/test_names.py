"""A lab's own words for columns."""

import numpy as np
import pandas as pd
import pytest
from made.frames import table
from made.notes import texts

from jgait import io
from jgait.io.names import column_of, placement_of
from jgait.types import RecordingError


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("GyroThighR_x", "thigh_right_gyr_x"),
        ("Gyro Thigh R X [deg/s]", "thigh_right_gyr_x"),
        ("shank_l_accel_z", "shank_left_acc_z"),
        ("RightThigh_AngularVelocity_z (rad/s)", "thigh_right_gyr_z"),
        ("LFoot.Gyro.X", "foot_left_gyr_x"),
        ("lowerback accx", "lower_back_acc_x"),
        ("thighRightGyrX", "thigh_right_gyr_x"),
        ("L5 Gyr_X", "lower_back_gyr_x"),
        ("L5_Acc_Z", "lower_back_acc_z"),
        ("l4AccY", "lower_back_acc_y"),
        ("Lumbar Gyro X", "lower_back_gyr_x"),
        ("sacrum_acc_z", "pelvis_acc_z"),
        ("foot_L_5_gyr_x", "foot_left_gyr_x"),
        ("Acc_X", "acc_x"),
        ("gyrX", "gyr_x"),
        ("Time (ms)", "time"),
        ("time_us", "time"),
        ("timestamp", "time"),
        ("Zeit_s", "time"),
        ("t_ms", "time"),
        ("Datetime", "time"),
        ("DateTime", "time"),
        ("Date Time", "time"),
        ("Datum_Uhrzeit", "time"),
        ("LF_gyro_x_rads", "foot_left_gyr_x"),
        ("GyroUnterschenkelLinks_z", "shank_left_gyr_z"),
        ("Fuß_li_acc_y", "foot_left_acc_y"),
        ("Knöchel re Gyr X", "ankle_right_gyr_x"),
        ("Pied Gauche Gyro Y", "foot_left_gyr_y"),
        ("muslo_derecho_acc_x", "thigh_right_acc_x"),
        ("Oberschenkel_rechts_Beschleunigung_x", "thigh_right_acc_x"),
        ("Kreuzbein_Drehrate_y", "pelvis_gyr_y"),
        ("pierna derecha Aceleración Z", "shank_right_acc_z"),
        ("piede sinistro giroscopio y", "foot_left_gyr_y"),
    ],
)
def test_words_of_a_column_give_its_placement(name, known):
    assert column_of(name) == known


@pytest.mark.parametrize(
    ("name", "placement"),
    [("LF", "foot_left"), ("RS", "shank_right"), ("SA", "pelvis"), ("1-1_lb", "lower_back"), ("12_rf", "foot_right"),
     ("walk_L5", "lower_back"), ("trial5", None),
     ("00B40C48", None), ("data", None), ("elf", None)],
)  # fmt: skip
def test_codes_of_two_letters_give_a_placement(name, placement):
    assert placement_of(name) == placement


@pytest.mark.parametrize(
    ("name", "placement"),
    [("Upper Back", None), ("upperback_imu", None), ("mid-back", None), ("Right Upper Arm", None), ("Chip1", None),
     ("barefoot_right", None), ("backpack", None), ("relationship", None), ("Upper Leg R", "thigh_right"),
     ("right_lower_leg", "shank_right"), ("lower right back", "lower_back"), ("tibia_r_imu", "shank_right"),
     ("rightfoot", "foot_right"), ("LFootSensor2", "foot_left"), ("shankl1", "shank_left"), ("Hips", "waist"),
     ("forehead", "head"), ("foot", None), ("left foot right", None)],
)  # fmt: skip
def test_a_word_within_a_word_is_no_placement(name, placement):
    assert placement_of(name) == placement


@pytest.mark.parametrize(
    "name",
    ["", "Date", "Quat_x", "mag_x", "Temp", "Packet counter", "FreeAcc_X", "Pelvis Linear Acceleration X",
     "tigh_right_gyr_x", "thigh_gyr_x", "gyr", "heart rate", "thigh_right_gyr"],
)  # fmt: skip
def test_other_names_of_columns_have_no_placement(name):
    assert column_of(name) is None


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


def test_the_clock_beside_a_date_is_the_time():
    frame = table().rename(columns={"time": "Timestamp"}).assign(DateTime="2026-05-03 10:00")
    assert io.recording_from_dataframe(frame).sampling_rate_hz == pytest.approx(100.0)


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
    with pytest.raises(RecordingError, match="no shank_right_gyr_x.*not recognised: 'shank_right_gyr_x_rev', "):
        io.recording_from_dataframe(frame)
