"""From files and arrays to recordings and back; every refusal is read."""

import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from made.frames import NEEDED, RATE, signals, table
from made.notes import of_code, texts

from jgait import io
from jgait.estimators import leg_ekf
from jgait.types import Estimate, Legs, LegTrajectory, RecordingError

THIGH_GYR = [f"thigh_right_gyr_{axis}" for axis in "xyz"]


def read(frame, **options):
    return io.recording_from_dataframe(frame, **options)


def scaled(frame, of, factor):
    """The table with some columns multiplied."""
    return frame.assign(**{name: factor * frame[name] for name in frame if of in name})


def fails(message, frame, **options):
    with pytest.raises(RecordingError, match=message):
        read(frame, **options)


# --- what is right is read ---


@pytest.mark.parametrize("separator, decimal", [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")])
@pytest.mark.parametrize("before", ["", "\n\n"], ids=["", "blank lines"])
def test_a_csv_file_in_any_dialect(tmp_path, before, separator, decimal):
    path = tmp_path / "anna_walk.csv"
    path.write_text(before + table().to_csv(index=False, sep=separator, decimal=decimal), encoding="utf-8-sig")
    recording = io.read_csv(path, subject="anna")
    assert (recording.name, recording.subject, list(recording.sensors)) == ("anna_walk", "anna", list(NEEDED))
    thigh = recording.sensors["thigh_right"]
    np.testing.assert_allclose(thigh.gyr, np.deg2rad(signals()["gyr"]), atol=1e-12)
    np.testing.assert_allclose(thigh.acc, signals()["acc"], atol=1e-12)
    np.testing.assert_allclose(thigh.time, table()["time"], atol=1e-12)
    assert thigh.mask.all() and "time taken to be in s" in str(texts(recording.notes))


def test_numbers_are_a_clock_in_the_unit_of_their_size_and_their_mean_is_the_rate():
    recording = read(table().assign(time=57354700 + np.arange(600) * 10))
    np.testing.assert_allclose(recording.sensors["thigh_right"].time, np.arange(600) / 100, atol=1e-9)
    for said in ("time taken to be in ms, because its steps are 10", "sampling rate 100 Hz, from the time stamps"):
        assert any(said in note for note in texts(recording.notes))
    stamps = np.round(np.arange(600) * 1000 / 128)
    assert read(table().assign(time=stamps)).sampling_rate_hz == pytest.approx(128.0, rel=1e-3)
    recording = read(table(time=False), sampling_rate_hz=50.0)
    np.testing.assert_allclose(recording.sensors["thigh_right"].time, np.arange(600) / 50)
    (note,) = of_code(recording.notes, "rate_stated")
    assert "their deviations contain that" in note.meaning


@pytest.mark.parametrize(
    "form",
    ["%Y-%m-%d %H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%fZ", "%H:%M:%S.%f", "%d.%m.%Y %H:%M:%S.%f", "%d.%m.%y %H:%M:%S,%f",
     "%m/%d/%Y %H:%M:%S.%f", "%d/%m/%Y %I:%M:%S.%f %p", "%I:%M:%S.%f %p", "%d-%b-%Y %H:%M:%S.%f",
     "%Y-%m-%d %H:%M:%S,%f", "%H:%M:%S,%f", "%I:%M:%S.%f", "datetime64[ns]", "datetime64[ms]", "timedelta64[ns]"],
)  # fmt: skip
@pytest.mark.parametrize("begin", ["2026-03-04 10:00", "2026-03-04 11:59:57.5", "2026-03-04 23:59:57.5"])
def test_dates_times_of_day_and_durations_are_a_clock(form, begin):
    since = pd.to_timedelta(table()["time"], unit="s")
    stamps = since if form.startswith("timedelta") else pd.Timestamp(begin) + since
    stamps = stamps.astype(form) if "64" in form else stamps.dt.strftime(form).str.removesuffix(".000000")
    frames = [table().assign(time=stamps.to_numpy())]
    frames += [table(time=False).set_index(pd.Index(stamps))] if "64" in form else []
    for recording in map(read, frames):
        np.testing.assert_allclose(recording.sensors["thigh_right"].time, np.arange(600) / 100, atol=1e-6)


def test_where_times_of_results_begin_is_noted(tmp_path):
    """Numbers by their first one, dates by their date, in UTC where the zone is known."""
    stamps = pd.Timestamp("2026-05-03 10:00") + pd.to_timedelta(table()["time"], unit="s")
    naive = table(time=False).set_index(pd.DatetimeIndex(stamps))
    for frame, values in (
        (table(), None),
        (table().set_index("time"), None),
        (table().assign(time=table()["time"] + 3600.0), ("clock_begins", {"begin_s": 3600.0})),
        (naive, ("clock_begins", {"date": "2026-05-03 10:00:00.000"})),
        (naive.tz_localize("Europe/Berlin").rename_axis("date"),
         ("clock_begins", {"date": "2026-05-03 08:00:00.000"})),
    ):  # fmt: skip
        notes = io.recording_from_dataframe(frame).notes
        found = [(note.code, note.values) for note in notes if note.code in ("clock_begins",)]
        assert found == ([] if values is None else [values])
    table().assign(time=stamps).to_csv(tmp_path / "walk.csv", index=False)
    for recording in (io.read_csv(tmp_path / "walk.csv"), io.read(tmp_path / "walk.csv")):
        np.testing.assert_allclose(recording.sensors["thigh_right"].time, np.arange(600) / 100, atol=1e-6)


def test_an_index_is_a_clock_if_it_is_named():
    seconds = table(time=False).set_index((table()["time"] + 50.0).to_numpy())
    fails(r"if the index without a name is the time, name it: table.rename_axis", seconds)
    assert read(seconds.rename_axis("time")).sampling_rate_hz == pytest.approx(100.0)


def test_what_is_written_is_read_back(tmp_path):
    recording = read(table())
    again = read(io.recording_to_dataframe(recording))
    from_file = io.read_csv(io.write_csv(recording, tmp_path / "walk.csv"))
    for placement, imu in recording.sensors.items():
        for one, other, filed in zip(imu, again.sensors[placement], from_file.sensors[placement], strict=True):
            np.testing.assert_allclose(one, other, atol=1e-12)
            np.testing.assert_allclose(one, filed, rtol=1e-7, atol=1e-9)


# --- missing samples become the mask ---


def test_nan_becomes_the_mask_and_never_a_number_elsewhere():
    frame = table()
    frame.loc[100:104, "thigh_right_gyr_y"] = np.nan
    frame.loc[300, "shank_right_acc_x"] = np.inf
    recording = read(frame)
    thigh, shank = recording.sensors["thigh_right"], recording.sensors["shank_right"]
    assert np.flatnonzero(~thigh.mask).tolist() == [100, 101, 102, 103, 104]
    assert np.flatnonzero(~shank.mask).tolist() == [300]
    np.testing.assert_array_equal(thigh.gyr[100:105], 0.0)
    assert shank.acc[300] == pytest.approx((shank.acc[299] + shank.acc[301]) / 2)
    assert all(np.isfinite(part).all() for imu in recording.sensors.values() for part in imu)
    assert "thigh_right: samples missing: 5 of 600" in texts(recording.notes)


def test_gaps_and_long_stretches_are_named_and_masked():
    frame = table().astype({"thigh_right_gyr_x": object})
    frame.loc[250:329, "thigh_right_gyr_x"] = np.nan
    frame.loc[7, "thigh_right_gyr_x"] = "n/a"
    recording = read(frame.drop(index=[*range(200, 220), 400]).reset_index(drop=True))
    thigh, shank = recording.sensors["thigh_right"], recording.sensors["shank_right"]
    np.testing.assert_allclose(thigh.time, np.arange(600) / 100, atol=1e-9)
    assert np.flatnonzero(~shank.mask).tolist() == [*range(200, 220), 400]
    assert np.flatnonzero(~thigh.mask).tolist() == [7, *range(200, 220), *range(250, 330), 400]
    np.testing.assert_allclose(thigh.gyr[330:400], np.deg2rad(signals()["gyr"][330:400]), atol=1e-12)
    assert "thigh_right: 0.80 s missing from 2.50 s" in texts(recording.notes)
    said = "2 gaps in time, the longest 0.21 s after 1.99 s; 21 samples inserted and masked"
    assert any(said in note for note in texts(recording.notes))


# --- units told by size ---


def test_radians_passed_as_degrees_but_not_standing_still():
    assert np.abs(read(table().iloc[:190]).sensors["thigh_right"].gyr).max() < 0.1
    frame = scaled(table(), "_gyr_", np.pi / 180.0)
    fails("too slow for walking: the gyroscopes seem to be in rad/s; pass gyr_unit='rad/s'", frame)
    fails("seem to be in rad/s", frame.loc[:, [name for name in frame if "_acc_" not in name]])
    # an hour with little more than a minute of walking
    rows = np.concatenate([np.resize(np.arange(190), 360_000), np.resize(np.arange(190, 600), 7_500)])
    day = frame.iloc[rows].assign(time=0.01 * np.arange(len(rows)))
    fails("seem to be in rad/s", day)


# --- tables that are refused ---


def waist(_):
    return table(placements=("waist",)).rename(columns=lambda name: name.replace("waist_", ""))


def later(frame, seconds):
    """The time of the second half moved by some seconds."""
    return frame.assign(time=frame.time + np.where(frame.index >= 300, seconds, 0.0))


RAW = "whole numbers and no unit, as raw counts have: multiply .* by gyr_unit$"
COLUMNS = r"expected columns \['thigh_right_gyr_x', .*\]; columns not recognised: "


def shaken(t):
    """Specific force without gravity, of about 1 m/s²."""
    names = [name for name in t if "_acc_" in name]
    return t.assign(**{name: np.sin(9.0 * t.time + k) * (1.0 + 0.2 * np.cos(t.time)) for k, name in enumerate(names)})


def counts(t):
    return scaled(t, "_gyr_", 16.4).round({name: 0 for name in t if "_gyr_" in name})


REFUSED = {
    "nothing measured": (
        lambda t: t.assign(thigh_right_gyr_x=np.nan, shank_right_gyr_x=np.nan), {},
        "recording: thigh_right has no usable sample; all 600 are missing",
    ),
    "degrees as radians": (
        lambda t: t, {"gyr_unit": "rad/s"},
        r"gyroscope of \w+ reaches \d+\.?\d* rad/s .99th percentile, given as rad/s., but nothing worn while walking "
        "exceeds 35 rad/s: it seems to be in deg/s; pass gyr_unit='deg/s'",
    ),
    "g as metres": (lambda t: scaled(t, "_acc_", 1 / 9.80665), {}, "it seems to be in g; pass acc_unit='g'"),
    "metres as g": (lambda t: t, {"acc_unit": "g"}, r"given as g.*it seems to be in m/s²; pass acc_unit='m/s\^2'"),
    "without gravity": (
        lambda t: t.assign(**{f"{one}_acc_x": t[f"{one}_acc_x"] - 9.81 for one in NEEDED}), {}, "gravity was taken off",
    ),
    "shaken without gravity": (shaken, {}, "gravity was taken off; record or export the specific force, with gravity$"),
    "raw counts": (counts, {}, RAW),
    "raw counts as degrees": (counts, {"gyr_unit": "deg/s"}, "exceeds 35 rad/s; its numbers are whole, as raw counts"),
    "another scale": (lambda t: scaled(t, "_acc_", 2.0), {}, "accelerometer of .* reads 19.* check the unit"),
    "converted twice": (lambda t: scaled(t, "_gyr_", 57.3), {}, "given as deg/s.*; is it in mrad/s, or was it conv"),
    "time backwards": (lambda t: later(t, -1.0), {}, r"time runs backwards at row 300 .*: 2 follows 2.99"),
    "time missing": (lambda t: t.assign(time=t.time.mask(t.index.isin([5, 9]))), {}, "in 2 rows, first in row 5"),
    "gap": (lambda t: later(t, 60.0), {}, r"60.0 s are missing after row 299 .*, more than 10 s; split the recording"),
    "no clock": (
        lambda t: table(time=False).assign(stamp=1.0), {},
        "has 600 rows and no column called 'time', so sampling_rate_hz is needed; .* not of sensors: stamp",
    ),
    "two clocks": (lambda t: t, {"sampling_rate_hz": 50.0}, "time stamps run at 100 Hz, but sampling_rate_hz is 50"),
    "rate": (lambda t: table(time=False), {"sampling_rate_hz": -1.0}, "sampling_rate_hz must be positive; got -1"),
    "milliseconds": (lambda t: t.assign(time=1000 * t.time), {"time_unit": "s"}, "0.11 s; it seems to be in ms"),
    "seconds": (lambda t: t, {"time_unit": "ms"}, "faster than 10 kHz; it seems to be in s: correct time_unit"),
    "rate's unit": (lambda t: t, {"gyr_unit": "degrees"}, "gyr_unit must be one of 'deg/s', 'rad/s', 'mdeg/s'"),
    "force's unit": (lambda t: t, {"acc_unit": "kg"}, "acc_unit must be one of 'm/s\\^2', 'g', 'mg'; got 'kg'"),
    "time's unit": (lambda t: t, {"time_unit": "ks"}, "time_unit must be one of 's', 'ms', 'us', 'ns'; got 'ks'"),
    "misspelt": (
        lambda t: t.rename(columns={"thigh_right_gyr_x": "thigh_rigth_gyr_x"}), {},
        "lacks thigh_right_gyr_x; 'thigh_rigth_gyr_x' looks like 'thigh_right_gyr_x': correct the header of the file; "
        f"{COLUMNS}'thigh_rigth_gyr_x'",
    ),
    "two levels": (
        lambda t: pd.concat({"left_sensor": t}, axis=1), {},
        r"has columns of 2 levels, such as \('left_sensor', 'time'\); expected .*; recording_from_gaitmap reads two",
    ),
    "short": (lambda t: t.iloc[:2], {}, "recording has 2 samples; at least 10 are needed"),
    "no known column": (lambda t: pd.DataFrame({"a": [1.0], "b": [2.0]}), {}, "found 'a', 'b'; columns are named"),
    "bare names": (waist, {}, "for one sensor with bare names give its place, such as placement='waist'"),
    "rates of another name": (
        lambda t: t.rename(columns={c: c.replace("_gyr_", " omega ") for c in t}), {},
        "holds no gyroscope.*if 'thigh_right omega x' is its rate, call it <placement>_gyr_x",
    ),
    "no gyroscope": (lambda t: t.drop(columns=THIGH_GYR), {}, "lacks thigh_right_gyr_x.* needs its gyroscope"),
    "words": (lambda t: t.assign(shank_right_gyr_y="fast"), {}, "'shank_right_gyr_y' holds no numbers; .* is 'fast'"),
    "odd times": (
        lambda t: t.assign(time=[f"{i}:s" for i in range(600)]), {}, "write times as 2026-05-03 10:00:00.25",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_tables_that_are_refused(name):
    changed, options, message = REFUSED[name]
    fails(message, changed(table()), **options)


LEFT_OUT = {
    "nothing measured": (lambda t: t.assign(thigh_right_gyr_x=np.nan), "it has no usable sample; all 600 are missing"),
    "constant": (
        lambda t: t.assign(**dict(zip(THIGH_GYR, [1.0, 2.0, 3.0], strict=True))),
        "its gyroscope is constant at (0.01745, 0.03491, 0.05236) rad/s; it recorded nothing",
    ),
    "converted twice": (
        lambda t: scaled(t, "thigh_right_gyr", 180.0 / np.pi),
        "is it in mrad/s, or was it converted twice? State the unit, or correct its columns in the file",
    ),
    "another scale": (
        lambda t: scaled(t, "thigh_right_acc", 2.0),
        "m/s² where it is calm (given as m/s^2), but gravity alone is 9.807 m/s²: check the unit",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LEFT_OUT)
def test_one_sensor_that_cannot_be_right_does_not_cost_the_others(name):
    changed, reason = LEFT_OUT[name]
    recording = read(changed(table()))
    assert list(recording.sensors) == ["shank_right"]
    (note,) = (note for note in recording.notes if note.values.get("placement") == "thigh_right")
    assert note.code == "sensor_left_out" and note.text.endswith(reason)
    assert note.text.startswith("thigh_right is left out: it")
    with pytest.raises(RecordingError, match=r"needs 'thigh_right'; the recording has .*; thigh_right is left out: it"):
        leg_ekf.estimate(leg_ekf.LegParams(), recording)


def test_counts_that_are_called_thousandths_are_read_with_a_doubt():
    rates = [name for name in table() if "_gyr_" in name]
    frame = scaled(table(), "_gyr_", 1e3 * np.pi / 180.0)
    whole, exact = (read(one, gyr_unit="mrad/s") for one in (frame.round(dict.fromkeys(rates, 0)), frame))
    assert sum("its gyroscope are whole, as raw counts" in text for text in texts(whole.notes)) == len(NEEDED)
    assert "raw counts" not in str(texts(exact.notes))


# --- columns and files ---


def test_a_file_or_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere.csv"):
        io.read_csv(tmp_path / "nowhere.csv")
    with pytest.raises(FileNotFoundError, match="none does not exist"):
        io.write_csv(estimate(), tmp_path / "none" / "out.csv")


# --- arrays ---


def arrays_fail(message, sensors, **options):
    with pytest.raises(RecordingError, match=message):
        io.recording_from_arrays(sensors, sampling_rate_hz=RATE, **options)


def test_arrays_that_do_not_fit():
    good = signals()
    arrays_fail("recording has no sensor; expected at least one of head", {})
    arrays_fail("no placement 'thigh_rite'; did you mean 'thigh_right'", {"thigh_rite": good})
    arrays_fail("no placement 'q'; known are head", {"q": good})
    arrays_fail(r"thigh_right needs 'gyr' of shape \(T, 3\); it has \['acc'\]", {"thigh_right": {"acc": good["acc"]}})
    arrays_fail(r"gyr of waist must have shape \(T, 3\); got \(3, 600\)", {"waist": {"gyr": good["gyr"].T}})
    arrays_fail(
        "gyr of shank_right has 500 samples; the others have 600", {"thigh_right": good, "shank_right": signals(500)}
    )
    arrays_fail(r"time must have one value a sample, \(600,\); got shape \(5,\)", {"waist": good}, time=np.arange(5))


# --- estimates out ---


def estimate():
    fields = ([0.0, np.pi / 6], [0.0, np.pi / 3], [0.0, 0.1], [-0.8, -0.7])
    leg = LegTrajectory(*(jnp.asarray(field) for field in fields))
    return Estimate(
        time=jnp.asarray([0.0, 0.01]),
        legs=Legs(leg, None),
        stddev=Legs(leg, None),
        distance=jnp.asarray([0.0, 0.02]),
        valid=jnp.asarray([False, True]),
        diagnostics={},
    )


def test_table_in_degrees_with_nan_where_invalid():
    frame = io.to_dataframe(estimate())
    assert list(frame.columns) == [
        "time_s", "hip_angle_right_deg", "knee_angle_right_deg", "x_right_m", "y_right_m",
        "hip_angle_right_std_deg", "knee_angle_right_std_deg", "x_right_std_m", "y_right_std_m", "distance_m", "valid",
    ]  # fmt: skip
    assert frame["hip_angle_right_deg"][1] == pytest.approx(30.0)
    assert frame["knee_angle_right_deg"][1] == pytest.approx(60.0)
    assert np.isnan(frame["hip_angle_right_deg"][0]) and not frame["valid"][0]
    assert frame["time_s"].tolist() == [0.0, 0.01]

    only = estimate()._replace(legs=Legs(None, None), stddev=None)
    assert list(io.to_dataframe(only)) == ["time_s", "distance_m", "valid"]
    with pytest.raises(ValueError, match=r"one recording, time of shape \(T,\); got shape \(2, 2\)"):
        io.to_dataframe(estimate()._replace(time=jnp.zeros((2, 2))))


def test_heavy_packages_wait_until_they_are_needed():
    code = (
        "import sys, jgait.io, jgait.datasets;"
        "print([name for name in ('pandas', 'scipy', 'pooch', 'python_calamine') if name in sys.modules])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"
