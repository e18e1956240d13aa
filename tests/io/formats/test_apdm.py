"""APDM Opal's `.h5`, written by this test in both of its layouts."""

import h5py
import numpy as np
import pytest
from made.known_walk import PLACES, RATE, SAMPLES, agrees, signals
from made.notes import texts

from jgait import RecordingError, io
from jgait.io.formats import apdm, registry

LABELS = {"lower_back": "Lumbar", "foot_right": "Right Foot", "foot_left": "Left Foot"}
START = 1_573_000_000_123_456
CASES = {"lower_back": "XI-003210", "foot_right": "XI-000099", "foot_left": "XI-004711"}


def padded(text, size=16):
    """As APDM writes strings: bytes of fixed size, filled up with zeros."""
    return np.bytes_(text.encode().ljust(size, b"\0"))


def stamps(begin=START, samples=SAMPLES):
    return (begin + np.arange(samples, dtype=np.uint64) * np.uint64(1e6 / RATE)).astype(np.uint64)


def write_new(path, places=PLACES, *, time=None, label=True, without=(), **changed):
    with h5py.File(path, "w") as file:
        file.attrs["FileFormatVersion"] = 5
        file.create_group("Processed")
        for place in places:
            group = file.create_group(f"Sensors/{CASES[place]}")
            gyr, acc = signals(place)
            fields = {"Gyroscope": gyr, "Accelerometer": acc, "Magnetometer": np.ones_like(acc)}
            fields |= {"Time": stamps() if time is None else time} | changed
            for key, values in fields.items():
                if key not in without:
                    group.create_dataset(key, data=values)
            about = group.create_group("Configuration").attrs
            about["Sample Rate"] = np.int64(RATE)
            if label:
                about["Label 0"] = padded(LABELS[place], 64)
    return path


def write_old(path, places=PLACES, *, prefix="", lists=True):
    with h5py.File(path, "w") as file:
        file.attrs["FileFormatVersion"] = 4
        if lists:
            file.attrs["CaseIdList"] = np.array([padded(CASES[place]) for place in places])
            file.attrs["MonitorLabelList"] = np.array([padded(LABELS[place]) for place in places])
        file.create_dataset("Annotations", data=np.zeros(3))
        for place in places:
            gyr, acc = signals(place)
            group = file.create_group(prefix + CASES[place])
            group.attrs["SampleRate"] = np.int64(RATE)
            group["Calibrated/Accelerometers"], group["Calibrated/Gyroscopes"] = acc, gyr
            group["Raw/Accelerometers"] = np.zeros_like(acc)
            group["Time"] = stamps()
    return path


@pytest.mark.parametrize("layout", ["new", "old", "oldest"])
def test_every_sample_of_every_sensor_comes_back(tmp_path, layout):
    path = tmp_path / "walk.h5"
    if layout == "new":
        write_new(path)
    else:
        # HDF5 lists groups by name, which is not the order of the labels: a reader that counts would mix the feet up.
        write_old(path, prefix="Opal_" if layout == "oldest" else "")
    assert registry.format_of(path) == "apdm"
    recording = io.read(path)
    assert set(recording.sensors) == set(PLACES)
    for place in PLACES:
        agrees(recording.sensors[place], place)
    assert (recording.sampling_rate_hz, recording.name) == (RATE, "walk")
    assert "read as APDM Opal HDF5 or CSV" in texts(recording.notes)
    assert any("'Right Foot' is taken to have sat at foot_right" in note for note in texts(recording.notes))


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"without": ["Gyroscope"]}, "Sensors/XI-003210 has no Gyroscope; it has Accelerometer, Configuration"),
        ({"Gyroscope": np.zeros((3, SAMPLES))}, r"Gyroscope must have shape \(samples, 3\); it has \(3, 250\)"),
        ({"Accelerometer": np.zeros((9, 3))}, r"Accelerometer must have shape \(250, 3\); it has \(9, 3\)"),
        ({"Time": np.arange(4)}, r"Time must have shape \(250,\); it has \(4,\)"),
        ({"places": []}, "expected the group Sensors"),
        ({"Gyroscope": np.full((SAMPLES, 3), b"x")}, "Gyroscope must be numbers"),
    ],
)
def test_a_malformed_file_is_named_with_what_is_lacking(tmp_path, changes, message):
    places = changes.pop("places", ["lower_back"])
    path = write_new(tmp_path / "bad.h5", places, **changes)
    with pytest.raises(RecordingError, match=f"bad.h5.*{message}"):
        apdm.measured(path)


def write_csv(path, number=7, barometer=True):
    """Mobility Lab's CSV: one column of times, three rows of a header, a block of columns a sensor."""
    kinds = ["Accelerometer", "Gyroscope", "Magnetometer"]
    head, columns = [[f"Format={number}"], ["Time"], [""]], [stamps()]
    for case, place in enumerate(PLACES, 5001):
        gyr, acc = signals(place)
        names = [name for kind in kinds for name in (kind, "", "")] + ["Barometer"] * barometer
        label = [str(case), "", "", LABELS[place], *[""] * (len(names) - 4)]
        for row, cells in zip(head, (label, names, [*"XYZ" * 3, *[""] * barometer]), strict=True):
            row += cells
        columns += [*acc.T, *gyr.T, *np.ones((3 + barometer, len(acc)))]
    rows = [[f"{int(row[0])}", *(f"{value:.9g}" for value in row[1:])] for row in zip(*columns, strict=True)]
    path.write_text("\n".join(",".join(row) for row in (*head, *rows)) + "\n")
    return path


@pytest.mark.parametrize(("number", "barometer"), [(7, True), (5, False)])
def test_mobility_labs_csv(tmp_path, number, barometer):
    path = write_csv(tmp_path / "walk.csv", number, barometer)
    recording = io.read(path)
    for place in PLACES:
        agrees(recording.sensors[place], place, within=1e-6)
    assert any(text.startswith("times count from 2019-11-06") for text in texts(recording.notes))
    text = path.read_text()
    path.write_text(text[:-40])
    assert any("ends within a row" in text for text in texts(io.read(path).notes))
    path.write_text(text.replace("Gyroscope", "Rotation"))
    with pytest.raises(RecordingError, match="sensor 'Lumbar' has no Gyroscope"):
        io.read(path)
