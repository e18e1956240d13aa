"""The xlsx walks: parsing by workbooks written here, the reference by the real files."""

import zipfile
from xml.sax.saxutils import escape

import numpy as np
import pytest
from made.notes import texts
from made.sets import loaded

from jgait.datasets import walking5m


@pytest.fixture(scope="module")
def walks(data):
    return data("walking5m")


# --- workbooks written here ---

SAMPLES = 600


def write_xlsx(path, header, rows):
    """The least that is a workbook: numbers as they are, text inline, None left empty."""

    def cell(value):
        if value is None:
            return "<c/>"
        if isinstance(value, str):
            return f'<c t="inlineStr"><is><t xml:space="preserve">{escape(value)}</t></is></c>'
        return f"<c><v>{value}</v></c>"

    body = "".join("<row>" + "".join(cell(value) for value in row) + "</row>" for row in [header, *rows])
    schemas, main = "http://schemas.openxmlformats.org", "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    office = f"{schemas}/officeDocument/2006/relationships"

    def related(kind, target):
        one = f'<Relationship Id="r1" Type="{office}/{kind}" Target="{target}"/>'
        return f'<Relationships xmlns="{schemas}/package/2006/relationships">{one}</Relationships>'

    sheet = '<sheets><sheet name="sensor_all" sheetId="1" r:id="r1"/></sheets>'
    parts = {
        "_rels/.rels": related("officeDocument", "xl/workbook.xml"),
        "xl/workbook.xml": f'<workbook xmlns="{main}" xmlns:r="{office}">{sheet}</workbook>',
        "xl/_rels/workbook.xml.rels": related("worksheet", "worksheets/sheet1.xml"),
        "xl/worksheets/sheet1.xml": f'<worksheet xmlns="{main}"><sheetData>{body}</sheetData></worksheet>',
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in parts.items():
            archive.writestr(name, text)


def columns(samples=SAMPLES):
    """Every sensor stands still for a while and then turns about z; upstream's blanks in the names."""
    table = {}
    count = np.arange(samples)
    for number in range(1, 8):
        table[f"Time_{number}"] = 57354700 + 10 * count
        swing = np.where(count > 300, 20000 * np.sin(count / 20), 0)
        for axis, acc, gyr in (("x", 10000, 30), ("y", 0, 10), ("z", 0, swing)):
            table[f"  Acc_read_{axis}_{number}"] = acc + 0 * count
            table[f"  Gyro_read_{axis}_{number}"] = gyr + 0 * count
    for number in (1, 6):
        table[f" Ext1_{number}"] = 700 + number + 0 * count
        table[f" Ext2_{number}"] = 500 + number + 0 * count
    return {name: [float(value) for value in values] for name, values in table.items()}


@pytest.fixture
def folder(data_dir):
    return data_dir / "walking5m" / "Dataset"


def load(folder, table, name="Young/new_1"):
    write_xlsx(folder / f"{name}.xlsx", list(table), list(zip(*table.values(), strict=True)))
    return loaded("walking5m", name)[0]


def test_scales_placements_and_insoles(folder):
    walk = load(folder, columns())
    recording = walk.recording
    assert set(recording.sensors) == set(walking5m.SENSORS.values())
    assert recording.name == recording.subject == "Young/new_1" and recording.sampling_rate_hz == 100.0
    thigh = recording.sensors["thigh_right"]
    np.testing.assert_allclose(thigh.time, np.arange(SAMPLES) / 100, atol=1e-9)
    np.testing.assert_allclose(thigh.acc, np.tile([9.80665, 0, 0], (SAMPLES, 1)))
    np.testing.assert_allclose(thigh.gyr[:, :2], np.tile(np.deg2rad([0.3, 0.1]), (SAMPLES, 1)))
    np.testing.assert_allclose(thigh.gyr[301:, 2], np.deg2rad(200 * np.sin(np.arange(301, SAMPLES) / 20)), atol=1e-9)
    assert thigh.mask.all()
    toe, heel = walk.info["insoles"]["left"]
    assert set(toe) == {706.0} and set(heel) == {506.0}
    assert walk.info["verified"] is False
    assert walk.info["group"] == "young"
    assert walk.info["lengths"] == {"right": (0.485, 0.446), "left": (0.485, 0.446)}
    assert "back sensor left out: it is not synchronised with the others" in texts(recording.notes)


def test_no_reference_has_a_reason(folder):
    table = columns()
    for number in (1, 6):
        table[f"  Gyro_read_x_{number}"] = [20000.0] * SAMPLES
    walk = load(folder, table)
    assert walk.reference is None and walk.info["windows"] == {}
    reason = "the foot stands 0 times; a stride needs two stances"
    assert walk.info["no_reference"] == f"right: {reason}; left: {reason}"


def test_gaps_are_interpolated_when_short_and_masked_when_long(folder):
    table = columns()
    for k in (*range(100, 103), *range(200, 220)):
        table["  Acc_read_x_5"][k] = None
    shank = load(folder, table).recording.sensors["shank_left"]
    assert np.flatnonzero(~shank.mask).tolist() == list(range(200, 220))
    np.testing.assert_array_equal(shank.gyr[200:220], 0.0)
    np.testing.assert_allclose(shank.acc[100:103, 0], 9.80665)


def test_clocks_that_repeat_run_backwards_or_start_late(folder):
    table = columns()
    table["Time_2"][50] = table["Time_2"][49]
    table["Time_2"][60] = table["Time_2"][59]
    table["Time_3"][300] -= 1000.0
    table["Time_4"] = [time + 30.0 for time in table["Time_4"]]
    for name in table:
        if name.endswith("_6"):  # at half the rate
            table[name] = [table[name][k - k % 2] for k in range(SAMPLES)]
    recording = load(folder, table).recording
    assert {len(imu.time) for imu in recording.sensors.values()} == {SAMPLES - 4}, "the part that all have"
    for words in (f"shank_right: 2 of {SAMPLES} rows are not read", f"foot_left: {SAMPLES // 2} of {SAMPLES} rows"):
        assert any(text.startswith(words) for text in texts(recording.notes))
    assert recording.sensors["thigh_right"].mask.all()
    # Sensor 4 is 30 ms late: what it reads at its sample k, the others read at k + 3.
    expected = np.deg2rad(200 * np.sin(np.arange(301, SAMPLES - 4) / 20))
    np.testing.assert_allclose(recording.sensors["thigh_left"].gyr[301:, 2], expected, atol=1e-9)


# --- the real walks ---


@pytest.fixture(scope="module")
def known(walks):
    """The walks on which what is asserted below was seen; a fuller set has others."""
    return [walk for walk in walks if walk.info["verified"]]


def test_units_by_gravity_and_segments_by_their_axes(known):
    for walk in known:
        for placement, imu in walk.recording.sensors.items():
            up = imu.acc[:50].mean(axis=0)
            assert np.linalg.norm(up) == pytest.approx(9.81, rel=0.06)
            assert up[0] * (-1 if placement.startswith("foot") else 1) > 8, "x runs along the segment"
        swing = {side: walk.recording.sensors[f"shank_{side}"].gyr[:, 2] for side in ("right", "left")}
        if not walk.info["misplaced"]:
            assert swing["right"].max() > -swing["right"].min(), "the right shank swings about +z"
            assert -swing["left"].min() > swing["left"].max(), "the left about -z"


def test_two_people_wear_thigh_and_shank_swapped(known):
    swapped = {walk.recording.name: walk.info["misplaced"] for walk in known if walk.info["misplaced"]}
    there = [walk.recording.name for walk in known]
    expected = [name for name in ("Elderly/20180417_2", "Elderly/20180417_4") if name in there]
    assert swapped == dict.fromkeys(expected, (("thigh_left", "shank_left"),))


def test_distances_are_about_five_metres_by_either_foot(known):
    """Authors' own foot trajectories, all twenty a group: 5.16 ± 0.43 m young, 5.68 ± 0.29 m elderly."""
    for group, authors, spread in (("young", 5.16, 0.43), ("elderly", 5.68, 0.29)):
        members = [walk for walk in known if walk.info["group"] == group]
        if not members:
            continue
        distances = np.array([walk.reference.distance[-1] for walk in members])
        assert distances.mean() == pytest.approx(authors, abs=2 * spread)
        assert ((distances > 4.5) & (distances < 6.0)).all()
        feet = np.array([[walk.info["feet"][side].distance[-1] for side in ("right", "left")] for walk in members])
        assert np.abs(feet[:, 0] - feet[:, 1]).mean() < 0.2


def test_windows_part_standing_from_walking(known):
    for walk in known:
        start, end = walk.info["windows"]["whole"]
        distance = walk.reference.distance
        assert distance[start] < 0.01
        assert distance[end - 1] == pytest.approx(distance[-1], abs=0.01)
