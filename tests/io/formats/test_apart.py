"""Signals of one sensor in files of their own, gravity beside the acceleration, and the signs of phones."""

import numpy as np
import pytest
from made import files as made_files
from made.notes import of_code, texts
from scipy.ndimage import uniform_filter1d

from jgait import io
from jgait.types import RecordingError

G = made_files.G
TURNED, ADDED = "the signs of the accelerometer are turned round", "accelerometer without gravity, and gravity, were"
MAC = "C42700000000"


def table(path, names, *columns, quote=False):
    names = [f'"{name}"' for name in names] if quote else names
    return made_files.put(path, [",".join(names), *made_files.lines_of(",", *columns)])


def gravity():
    """Gravity as a phone's filter gives it: the slow part of the specific force, of gravity's size."""
    slow = uniform_filter1d(made_files.walk()[2], 60, axis=0)
    return G * slow / np.linalg.norm(slow, axis=1, keepdims=True)


def at(time, signal, apart):
    """A signal (T, 3) at later times, as a second clock samples it."""
    return np.stack([np.interp(time + apart, time, column) for column in signal.T], axis=1)


def sensor_logger(folder, platform="android", *, standardised=False, total=True, metadata=True, since=1.7e18):
    """Sensor Logger's folder: axes from z to x, m/s² and rad/s without a unit, an iPhone's signs turned round."""
    time, gyr, acc = made_files.walk()
    sign = -1.0 if platform == "ios" and not standardised else 1.0
    folder.mkdir(exist_ok=True)
    signals = {"Accelerometer": sign * (acc - gravity()), "Gravity": sign * gravity(), "Gyroscope": gyr,
               "Magnetometer": np.ones_like(gyr)}  # fmt: skip
    signals |= {"TotalAcceleration": sign * acc} if total else {}
    for name, values in signals.items():
        stamps = [f"{int(since) + round(1e9 * t)}" for t in time]
        lines = made_files.lines_of(",", 0.1 + time, *values.T[::-1])
        made_files.put(folder / f"{name}.csv", ["time,seconds_elapsed,z,y,x",
                       *(f"{stamp},{line}" for stamp, line in zip(stamps, lines, strict=True))])  # fmt: skip
    if metadata:
        about = ["version,platform,standardisation", f"3,{platform},{str(standardised).lower()}"]
        made_files.put(folder / "Metadata.csv", about)
    return folder


def phyphox(folder, names=("Accelerometer", "Gyroscope"), columns="{axis} ({unit})", apart=0.0, linear=False):
    """phyphox' folder: a quoted header with units, times from the start of the experiment."""
    time, gyr, acc = made_files.walk()
    folder.mkdir(exist_ok=True)
    acc = acc - gravity() if linear else acc
    for name, values, unit in zip(names, (acc, at(time, gyr, apart)), ("m/s^2", "rad/s"), strict=True):
        header = ["Time (s)", *(columns.format(name=name, axis=axis, unit=unit) for axis in "XYZ")]
        table(folder / f"{name}.csv", header, time + apart * (unit == "rad/s"), *values.T, quote=True)
    return folder


def metabase(folder, prefix="walk", mac=MAC, start="2022-08-05T15.26.13.153", step=1, sign=1.0):
    """MetaBase's two files of a device: g and deg/s by the header, three clocks."""
    time, gyr, acc = made_files.walk()
    folder.mkdir(exist_ok=True)
    for name, values, unit, every in (("Accelerometer", acc / G, "g", step),
                                      ("Gyroscope", np.rad2deg(gyr), "deg/s", 1)):  # fmt: skip
        stamps = np.round(1e3 * time[::every])
        lines = made_files.lines_of(",", stamps + 1659731173153, 0 * stamps, time[::every], *(sign * values[::every]).T)
        header = f"epoc (ms),timestamp (-0500),elapsed (s),x-axis ({unit}),y-axis ({unit}),z-axis ({unit})"
        name = f"{prefix}_MetaWear_{start}_{mac}_{name}_{100 / every:.3f}Hz_1.4.4.csv"
        made_files.put(folder / name, [header, *lines])
    return folder


CORE_MOTION = ("rotationRate", "gravity", "userAcceleration")


def core_motion(path, spelt="{signal}.{axis}", words=CORE_MOTION, unit="", clock=()):
    _, gyr, acc = made_files.walk()
    signals = (gyr, -gravity() / G, -(acc - gravity()) / G)
    names = [spelt.format(signal=word, axis=axis) + unit * (k > 0) for k, word in enumerate(words) for axis in "xyz"]
    time = (made_files.walk()[0],) if clock else ()
    return table(path, [*clock, *names], *time, *np.hstack(signals).T)


@pytest.mark.parametrize(
    "options",
    [{}, {"platform": "ios"}, {"platform": "ios", "total": False}, {"platform": "ios", "standardised": True},
     {"total": False}, {"metadata": False}],
)  # fmt: skip
def test_sensor_logger(tmp_path, options):
    folder = sensor_logger(tmp_path / "walk", **options)
    recording = io.read(folder, placement="lower_back")
    made_files.check(recording, "lower_back")
    turned = options.get("platform") == "ios" and not options.get("standardised")
    assert (TURNED in str(texts(recording.notes))) == turned
    assert (ADDED in str(texts(recording.notes))) == (not options.get("total", True))
    assert "times count from 2023-11-14 22:13:20.000, the date of the first sample" in texts(recording.notes)
    again = io.read({"lower_back": folder / "Gyroscope.csv"})
    np.testing.assert_array_equal(again.sensors["lower_back"].acc, recording.sensors["lower_back"].acc)
    with pytest.raises(RecordingError, match="Accelerometer.csv holds no gyroscope.* is in Gyroscope.csv: give this"):
        io.read(folder / "Accelerometer.csv", placement="lower_back")


def test_what_the_system_or_gravity_is_needed_for_is_named(tmp_path):
    folder = sensor_logger(tmp_path / "walk", "ios", metadata=False, total=False)
    with pytest.raises(RecordingError, match="walk lacks Metadata.csv, which states the phone's system: iPhone"):
        io.read(folder, placement="lower_back")
    (folder / "Gravity.csv").unlink()
    with pytest.raises(RecordingError, match="gravity is not in Accelerometer.csv .*record the accelerometer with"):
        io.read(folder, placement="lower_back")
    (folder / "Gyroscope.csv").unlink()
    with pytest.raises(RecordingError, match="walk holds no gyroscope, which every method"):
        io.read(folder, placement="lower_back")


@pytest.mark.parametrize(
    "options",
    [{}, {"columns": "Acceleration {axis} ({unit})", "names": ("Accelerometer", "Gyroscope")},
     {"names": ("Beschleunigung", "Gyroskop"), "columns": "{name} {axis} ({unit})"}, {"names": ("A", "B")}],
)  # fmt: skip
def test_phyphox(tmp_path, options):
    if "Acceleration" in options.get("columns", ""):
        options["columns"] = "{axis} ({unit})"
    recording = io.read(phyphox(tmp_path / "walk", **options), placement="waist")
    made_files.check(recording, "waist")
    assert "states no unit" not in str(texts(recording.notes)) and not of_code(recording.notes, "up_unsure")


@pytest.mark.parametrize("step", [1, 2])
def test_metabase_also_with_two_rates(tmp_path, step):
    recording = io.read(metabase(tmp_path / "walk", step=step), placement="foot_right")
    assert recording.sampling_rate_hz == pytest.approx(100.0)
    imu, (_, gyr, acc) = recording.sensors["foot_right"], made_files.walk()
    np.testing.assert_allclose(imu.gyr[:-1], gyr[: len(imu.gyr) - 1], atol=1e-6)
    np.testing.assert_allclose(imu.acc[::step], acc[: len(imu.acc) : step], atol=1e-6)
    assert bool(of_code(recording.notes, "times_corrected")) == (step > 1)


def test_devices_and_recordings_of_a_folder(tmp_path):
    metabase(tmp_path / "walk")
    metabase(tmp_path / "walk", mac="E1AB00000001", sign=-1.0)
    recording = io.read(tmp_path / "walk", placements={MAC: "foot_right", "E1AB00000001": "foot_left"})
    made_files.check(recording, "foot_right")
    np.testing.assert_allclose(recording.sensors["foot_left"].gyr, -made_files.walk()[1], atol=1e-6)
    metabase(tmp_path / "walk", start="2022-08-05T16.00.00.000")
    with pytest.raises(RecordingError, match="walk holds 3 recordings, such as .*: give the gyroscope's file of one"):
        io.read(tmp_path / "walk")
    (file,) = (tmp_path / "walk").glob(f"*15.26*{MAC}_Gyro*")
    made_files.check(io.read(file, placement="foot_right"))


@pytest.mark.parametrize("apart", [False, True])
def test_two_shoes_are_one_recording_if_names_tell_them_apart(tmp_path, apart):
    names = {"left": ("LeftShoe", "C42700000000"), "right": ("foot_right", "E1AB00000001")}
    for side, (prefix, mac) in names.items():
        folder = tmp_path / f"{side}_foot" if apart else tmp_path
        metabase(folder, prefix="walk" if apart else prefix, mac=mac, sign=1.0 if side == "right" else -1.0)
    if not apart:
        for file in tmp_path.iterdir():
            file.rename(tmp_path / file.name.replace("E1AB00000001", "").replace("C42700000000", ""))
    recording = io.read(tmp_path)
    made_files.check(recording, "foot_right")
    np.testing.assert_allclose(recording.sensors["foot_left"].gyr, -made_files.walk()[1], atol=1e-6)


@pytest.mark.parametrize(
    "options",
    [{}, {"spelt": "{signal}{axis}"},
     {"words": ("motionRotationRate", "motionGravity", "motionUserAcceleration"), "spelt": "{signal}_{axis}",
      "unit": "(G)", "clock": ("motionTimestamp_sinceReboot(s)",)}],
)  # fmt: skip
def test_core_motion(tmp_path, options):
    rate = {} if "clock" in options else {"sampling_rate_hz": 100.0}
    path = core_motion(tmp_path / "walk.csv", **options)
    recording = io.read(path, placement="waist", **rate)
    made_files.check(recording, "waist")
    assert all(words in str(texts(recording.notes)) for words in (TURNED, ADDED))
    assert not of_code(recording.notes, "up_unsure")
    with pytest.raises(RecordingError, match="does not state where its sensors sat"):
        io.read(path, **rate)


def test_signs_of_an_unknown_program_are_a_doubt(tmp_path):
    time, gyr, acc = made_files.walk()
    for name, values, unit in (("gyro", gyr, "rad/s"), ("acc", acc, "m/s^2")):
        table(tmp_path / f"{name}.csv", ["timestamp_ns", *(f"{a} [{unit}]" for a in "xyz")], 1e9 * time, *values.T)
    recording = io.read(tmp_path, placement="waist")
    made_files.check(recording, "waist")
    assert of_code(recording.notes, "up_unsure")
