"""Units in the names of columns: used for each signal of each sensor, overruled by arguments, and doubted."""

import numpy as np
import pytest
from made.frames import NEEDED, signals, table
from made.notes import texts

from jgait import io
from jgait.io.units import ACC_UNITS, GYR_UNITS, known_unit, unit_of_columns
from jgait.types import RecordingError


def stated(kind, unit, placements=NEEDED, *, true=None, between=" [{}]"):
    """The table with the unit in the names of some columns, whose numbers are in the true unit."""
    units, usual = (GYR_UNITS, "deg/s") if kind == "gyr" else (ACC_UNITS, "m/s^2")
    names = [f"{where}_{kind}_{axis}" for where in placements for axis in "xyz"]
    frame = table().copy()
    frame[names] *= units[usual] / units[true or unit]
    return frame.rename(columns={name: name + between.format(unit) for name in names})


def same(recording):
    """Whether the recording is that of the table in deg/s and m/s²."""
    for seed, placement in enumerate(NEEDED):
        imu = recording.sensors[placement]
        np.testing.assert_allclose(imu.gyr, np.deg2rad(signals(seed=seed)["gyr"]), atol=1e-9)
        np.testing.assert_allclose(imu.acc, signals(seed=seed)["acc"], atol=1e-9)
        assert imu.mask.all()
    return True


@pytest.mark.parametrize("read", [io.read_csv, io.read])
@pytest.mark.parametrize(
    ("kind", "unit", "between", "known"),
    [("gyr", "rad/s", " [{}]", "rad/s"), ("gyr", "deg/s", " ({})", "deg/s"), ("gyr", "mdps", " {{{}}}", "mdeg/s"),
     ("gyr", "mrad/s", " ({})", "mrad/s"),
     ("acc", "g", " [{}]", "g"), ("acc", "mg", " ({})", "mg"), ("acc", "m/s²", " [{}]", "m/s^2"),
     ("acc", "m/(s^2)", " [{}]", "m/s^2"), ("gyr", "dps", "_{}", "deg/s"), ("gyr", "rad_s", "_{}", "rad/s"),
     ("gyr", "deg_per_s", "_{}", "deg/s"), ("gyr", "rad/s", " {}", "rad/s"), ("acc", "mps2", "_{}", "m/s^2"),
     ("acc", "g", "_{}", "g"), ("acc", "m_s2", "_{}", "m/s^2"), ("gyr", "rads", "_{}", "rad/s"),
     ("gyr", "radps", "_{}", "rad/s"), ("gyr", "degs", "_{}", "deg/s"), ("acc", "ms2", "_{}", "m/s^2")],
)  # fmt: skip
def test_the_unit_in_the_names_of_columns_is_used(tmp_path, read, kind, unit, between, known):
    stated(kind, unit, between=between, true=known).to_csv(tmp_path / "walk.csv", index=False)
    recording = read(tmp_path / "walk.csv")
    assert same(recording)
    said = f"units by the header: {kind} in {known} (thigh_right, shank_right)"
    assert [text for text in texts(recording.notes) if text.startswith("units by")] == [said]


def test_an_argument_wins_over_the_header(tmp_path):
    frame = stated("gyr", "rad/s", true="deg/s")
    frame.to_csv(tmp_path / "walk.csv", index=False)
    assert same(io.recording_from_dataframe(frame, gyr_unit="deg/s"))
    recording = io.read(tmp_path / "walk.csv", gyr_unit="deg/s")
    assert same(recording)
    assert not any("by the header" in text for text in texts(recording.notes))
    mixed = frame.rename(columns={"thigh_right_gyr_x [rad/s]": "thigh_right_gyr_x [rev/s]"})
    assert same(io.recording_from_dataframe(mixed, gyr_unit="deg/s"))


CONTRADICTED = {
    "degrees": ("gyr", "rad/s", "deg/s", r"99th percentile, rad/s by the header.* seems to be in deg/s; correct the "
                "header, or pass gyr_unit='deg/s'"),
    "radians": ("gyr", "deg/s", "rad/s", r"shank_right, deg/s by the header\), too slow for walking: the gyroscopes "
                "seem to be in rad/s; correct the header, or pass gyr_unit='rad/s'"),
    "milliradians": ("gyr", "mdeg/s", "mrad/s", r"mdeg/s by the header\), too slow .* seem to be in mrad/s; correct"),
    "milliradians as degrees": ("gyr", "deg/s", "mrad/s", r"deg/s by the header.*; is it in mrad/s, or was"),
    "milliradians as radians": ("gyr", "rad/s", "mrad/s", r"rad/s by the header.* seems to be in mrad/s; correct"),
    "milli": ("gyr", "mdeg/s", "deg/s", r"mdeg/s by the header\), too slow .* seem to be in deg/s; correct"),
    "metres": ("acc", "g", "m/s^2", r"calm \(g by the header\).* seems to be in m/s²; correct the header, or pass "
               r"acc_unit='m/s\^2'"),
    "metres as mg": ("acc", "mg", "m/s^2", r"calm \(mg by the header\).* seems to be in m/s²; correct the header"),
}  # fmt: skip


@pytest.mark.parametrize("name", CONTRADICTED)
@pytest.mark.parametrize("read", [io.read_csv, io.read])
def test_a_header_that_the_signals_contradict_is_named(tmp_path, name, read):
    kind, unit, true, message = CONTRADICTED[name]
    stated(kind, unit, true=true).to_csv(tmp_path / "walk.csv", index=False)
    with pytest.raises(RecordingError, match=message) as caught:
        read(tmp_path / "walk.csv")
    assert len(str(caught.value)) <= 300


def test_one_sensor_whose_header_is_wrong_does_not_cost_the_others():
    recording = io.recording_from_dataframe(stated("gyr", "rad/s", ["thigh_right"], true="deg/s"))
    (note,) = (note for note in recording.notes if note.code == "sensor_left_out")
    assert note.text.startswith("thigh_right is left out: its gyroscope reaches")
    assert "rad/s by the header), but nothing worn while walking" in note.text
    assert note.text.endswith("it seems to be in deg/s; correct the header of this sensor")
    slow = io.recording_from_dataframe(stated("gyr", "deg/s", ["thigh_right"], true="rad/s"))
    (note,) = (note for note in slow.notes if note.code == "sensor_contradicts")
    assert note.text.startswith("thigh_right: the gyroscope reaches only")
    assert "(99th percentile, deg/s by the header) while" in note.text


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["gyr_x [rad/s]", "gyr_y [deg/s]", "gyr_z [rad/s]"], r"must state one unit; 'gyr_x \[rad/s\]' rad/s, "),
        (["gyr_x [rad/s]", "gyr_y", "gyr_z"], "'gyr_y' none, 'gyr_z' none; convert columns, or correct the header"),
        (["gyr_x [g]", "gyr_y [g]", "gyr_z [g]"], r"'gyr_x \[g\]' is in 'g'; expected one of deg/s, rad/s, mdeg/s"),
        (["gyr_x (rev/s)", "gyr_y (rev/s)", "gyr_z (rev/s)"], "is in 'rev/s'; expected one of deg/s"),
    ],
)
def test_mixed_and_unknown_units_are_refused(names, message):
    with pytest.raises(RecordingError, match=message):
        unit_of_columns(names, "gyr", "walk")


@pytest.mark.parametrize(
    ("spelt", "known"),
    [("Deg/Sec", "deg/s"), ("degrees/second", "deg/s"), ("°·s⁻¹", "deg/s"), ("rad s^-1", "rad/s"), ("m s−2", "m/s^2"),
     ("m/s**2", "m/s^2"), ("G", "g"), ("lsb", None), ("right", None), ("", None)],
)  # fmt: skip
def test_spellings(spelt, known):
    assert known_unit(spelt) == known
