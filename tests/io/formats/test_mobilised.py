"""Mobilise-D's `data.mat`: written by this test as the specification says, and the real ones of mobgap."""

import itertools
import struct

import numpy as np
import pytest
from made.known_walk import GRAVITY, PLACES, RATE, SAMPLES, agrees, signals
from made.notes import texts
from scipy.io import savemat

from jgait import RecordingError, io
from jgait.datasets import registry
from jgait.io.formats.matlab import read_matlab

LABELS = {"lower_back": "LowerBack", "foot_right": "RightFoot", "foot_left": "LeftFoot"}
START = 1_607_605_064.733


def sensor(place, *, start=START, samples=SAMPLES, **changed):
    gyr, acc = signals(place, samples)
    fields = {"Acc": acc / GRAVITY, "Gyr": np.rad2deg(gyr), "Fs": {"Acc": RATE, "Gyr": RATE, "Bar": RATE}}
    if start is not None:
        fields["Timestamp"] = (start + np.arange(samples) / RATE)[:, None]
    fields |= changed
    return {key: value for key, value in fields.items() if value is not None}


def trial(**devices):
    return {"StartDateTime": "2020-12-10T13:57:44.733+01:00", **devices}


@pytest.fixture
def write(tmp_path):
    def written(data, name="data.mat"):
        folder = tmp_path / "P07"
        folder.mkdir(exist_ok=True)
        savemat(folder / name, {"data": data})
        return folder / name

    return written


@pytest.fixture
def both(write):
    """Two trials; in the second the feet wore INDIP's sensors, and so did the lower back."""
    indip = {LABELS[place]: sensor(place) for place in PLACES} | {"LeftPressureInsole": {"Force": np.zeros(4)}}
    second = trial(SU={"LowerBack": sensor("lower_back")}, SU_INDIP=indip, Standards={"INDIP": {"Fs": 100.0}})
    return write(
        {"TimeMeasure1": {"Test5": {"Trial1": trial(SU={"LowerBack": sensor("lower_back")}), "Trial2": second}}}
    )


def test_every_sample_of_a_trial_comes_back_in_si_units(both):
    recording = io.read_mobilised(both, trial="TimeMeasure1/Test5/Trial1")
    assert list(recording.sensors) == ["lower_back"]
    agrees(recording.sensors["lower_back"], "lower_back")
    assert (recording.sampling_rate_hz, recording.subject) == (RATE, "P07")
    assert recording.name == "P07/TimeMeasure1/Test5/Trial1"


def test_all_trials_and_all_devices(both):
    assert io.mobilised_trials(both) == ("TimeMeasure1/Test5/Trial1", "TimeMeasure1/Test5/Trial2")
    second = io.read_mobilised(both, trial="TimeMeasure1/Test5/Trial2")
    assert set(second.sensors) == set(PLACES)
    for place in PLACES:
        agrees(second.sensors[place], place)
    assert any("SU_INDIP.LowerBack (another device was worn there)" in note for note in texts(second.notes))
    assert set(io.read_mobilised(both, trial="Test5/Trial2").sensors) == set(PLACES)


def test_trials_of_one_name_are_numbered(write):
    first, second = (np.array([(trial(SU={"LowerBack": sensor(place)}),)], [("Trial", object)]) for place in PLACES[:2])
    path = write({"T": {"Test5": {"Trial": np.concatenate([first, second])["Trial"]}, "Test6": {"A": trial(SU={})}}})
    assert io.mobilised_trials(path) == ("T/Test5/Trial(1)", "T/Test5/Trial(2)", "T/Test6/A")
    agrees(io.read_mobilised(path, trial="Trial(2)").sensors["lower_back"], PLACES[1])


def test_devices_that_start_apart_share_the_time_in_which_both_ran(write):
    su = {"LowerBack": sensor("lower_back")}
    path = write({"T": {"A": trial(SU=su, SU_INDIP={"LeftFoot": sensor("foot_left", start=START + 0.5)})}})
    recording = io.read_mobilised(path)
    gyr, _ = signals("lower_back")
    # Unix seconds are known to 2.4e-7 s, which moves interpolated samples by that much of the slope.
    np.testing.assert_allclose(recording.sensors["lower_back"].gyr[:100], gyr[50:150], atol=1e-5)
    np.testing.assert_allclose(recording.sensors["foot_left"].gyr[:100], signals("foot_left")[0][:100], atol=1e-5)


@pytest.mark.parametrize(
    "changed, message",
    [
        ({"Gyr": np.zeros((SAMPLES, 2))}, r"SU\.LowerBack\.Gyr must have shape \(samples, 3\); it has \(250, 2\)"),
        ({"Acc": np.ones((SAMPLES - 1, 3))}, r"Acc must have shape \(250, 3\); it has \(249, 3\)"),
        ({"Fs": None}, r"no sampling rate Fs\.Gyr; it has Acc, Gyr, Timestamp"),
        ({"Fs": {"Acc": 50.0, "Gyr": 100.0}}, "must share a rate; Fs states 50.* and 100"),
        ({"Fs": {"Gyr": -1.0}}, r"Fs must be positive; it is -1"),
        ({"Timestamp": np.arange(9.0)}, r"Timestamp must have shape \(250,\); it has \(9,\)"),
        ({"Gyr": None}, r"no sensor with a gyroscope, Gyr; it has SU\.LowerBack"),
        ({"Acc": signals("lower_back")[1]}, r"accelerometer of lower_back reads 96\.15 m/s² where it is calm"),
    ],
)
def test_a_malformed_sensor_is_named(write, changed, message):
    path = write({"T": {"A": trial(SU={"LowerBack": sensor("lower_back", **changed)})}})
    with pytest.raises(RecordingError, match=message):
        io.read_mobilised(path)


def with_string(path):
    """Adds to a file a variable `more`: a struct of a string, which SciPy reads and does not write, and of a text of
    no bytes.
    """

    def element(kind, content):
        return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)

    def array(held, *parts, name=b"", shape=(1, 1)):
        about = () if held == 17 else (element(5, struct.pack("<2i", *shape)), element(1, name))
        return element(14, b"".join((element(6, struct.pack("<II", held, 0)), *about, *parts)))

    reference = array(13, element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1)), shape=(6, 1))
    string = array(17, *(element(1, text) for text in (b"", b"MCOS", b"string")), reference)
    names = element(5, struct.pack("<i", 8)), element(1, b"string".ljust(8, b"\0") + b"empty".ljust(8, b"\0"))
    path.write_bytes(path.read_bytes() + array(2, *names, string, array(4, element(4, b"")), name=b"more"))


@pytest.mark.parametrize("compressed", [False, True])
def test_a_damaged_structure_never_reaches_scipy(tmp_path, compressed):
    """SciPy ends the process at some types and lengths; each byte of a small file is damaged in turn."""
    path = tmp_path / "data.mat"
    tree = {"Fs": 100.0, "name": "foot", "list": np.array([1.0, "two"], dtype=object), "flag": np.array([True])}
    savemat(path, {"data": tree, "beside": 1j * np.ones(3)}, do_compression=compressed)
    with_string(path)
    good, needed = path.read_bytes(), ("data", "beside", "more")
    content = read_matlab(path, needed, ("lacks",), simplify_cells=True)
    assert set(content) == set(needed) and content["data"]["name"] == "foot"
    assert list(content["more"]) == ["string", "empty"]
    refused = 0
    for at, value in itertools.product(range(124, len(good)), (0x00, 0x11, 0xFF)):
        path.write_bytes(good[:at] + bytes([value]) + good[at + 1 :])
        try:
            read_matlab(path, needed)
        except RecordingError:
            refused += 1
    assert refused > 0.2 * 3 * len(good[124:])
    path.write_bytes(good[: len(good) - 9])
    with pytest.raises(
        RecordingError, match="data.mat cannot be read; expected a MATLAB file of version 5 to 7: an element of"
    ):
        read_matlab(path, needed)


def test_real_trials_are_those_of_the_data_set(data):
    """Two ways to read the same file; the data set's own is checked against mobgap."""
    walks = {walk.recording.name: walk for walk in data("mobgap_lab")}
    path, _ = registry.file("mobgap_lab", "example_data/data/lab/HA/001/data.mat")
    every = {trial: io.read_mobilised(path, trial=trial) for trial in io.mobilised_trials(path)}
    assert list(every) == ["TimeMeasure1/Test5/Trial1", "TimeMeasure1/Test5/Trial2", "TimeMeasure1/Test11/Trial1"]
    for key, recording in every.items():
        known = walks["HA/001/" + key.removeprefix("TimeMeasure1/")].recording
        ours, theirs = recording.sensors["lower_back"], known.sensors["lower_back"]
        assert recording.sampling_rate_hz == known.sampling_rate_hz == 100.0
        np.testing.assert_array_equal(ours.mask, theirs.mask)
        for field in ("time", "gyr", "acc"):
            np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), atol=1e-9)
