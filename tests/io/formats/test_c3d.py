"""C3D files, written by ezc3d, of a body whose markers are known."""

import ezc3d
import numpy as np
import pytest
from made.notes import texts

from jgait import RecordingError, io
from jgait.io.formats.c3d import UPRIGHT

RATE, SAMPLES, FIRST, PER_FRAME = 100.0, 120, 51, 10
SIDEWAYS = {"R": -0.1, "L": 0.1}


def body():
    """Markers in metres, x forward, y left, z up: somebody walks along x, the legs swing out of phase."""
    t = np.arange(SAMPLES) / RATE
    found = {}
    for letter, y in SIDEWAYS.items():
        swing = 0.4 * np.sin(2.0 * np.pi * t + (np.pi if letter == "L" else 0.0))
        hip = np.stack([0.2 + 1.2 * t, np.full_like(t, y), 0.9 + 0.02 * np.cos(4.0 * np.pi * t)], axis=1)
        bone = 0.42 * np.stack([np.sin(swing), 0.0 * t, -np.cos(swing)], axis=1)
        knee, ankle = hip + bone, hip + bone + 0.42 * np.array([-0.1, 0.0, -0.995])
        found |= {f"{letter}HJC": hip, f"{letter}KJC": knee, f"{letter}AJC": ankle}
        found |= {f"{letter}HEE": ankle + [-0.05, 0.0, -0.03], f"{letter}TOE": ankle + [0.15, 0.0, -0.03]}
        found |= {f"{letter}ASI": hip + [0.08, 0.3 * y, 0.1], f"{letter}PSI": hip + [-0.1, -0.3 * y, 0.1]}
    return found


@pytest.fixture(scope="module")
def truth():
    return body()


def write(path, markers, *, units="mm", factor=1e3, screen="+Z", events=True, outputs=None, first=FIRST):
    file = ezc3d.c3d()
    every = {name: factor * place for name, place in markers.items()} | (outputs or {})
    points = np.ones((4, len(every), SAMPLES))
    for i, place in enumerate(every.values()):
        points[:3, i] = place.T
    file["parameters"]["POINT"]["LABELS"]["value"] = list(every)
    file["parameters"]["POINT"]["RATE"]["value"] = [RATE]
    file["parameters"]["POINT"]["UNITS"]["value"] = [units] if units else [""]
    file["header"]["points"]["first_frame"] = first - 1
    file["data"]["points"] = points
    file["parameters"]["ANALOG"]["RATE"]["value"] = [PER_FRAME * RATE]
    file["parameters"]["ANALOG"]["LABELS"]["value"] = ["Fz1", "Trigger"]
    file["parameters"]["ANALOG"]["UNITS"]["value"] = ["N", "V"]
    file["data"]["analogs"] = analog()[None]
    if screen:
        file.add_parameter("POINT", "Y_SCREEN", [screen])
    if outputs:
        file.add_parameter("POINT", "ANGLES", list(outputs))
    if events:
        file.add_parameter("EVENT", "USED", [3])
        file.add_parameter("EVENT", "TIMES", np.array([[0.0, 0.0, 1.0], [0.9, 0.7, 1.25]]))
        file.add_parameter("EVENT", "LABELS", ["Foot Off", "Foot Strike", "Clap"])
        file.add_parameter("EVENT", "CONTEXTS", ["Left", "Right", "General"])
    file.write(str(path))
    return path


def analog():
    t = np.arange(PER_FRAME * SAMPLES) / (PER_FRAME * RATE)
    return np.stack([700.0 + 50.0 * np.sin(9.0 * t), 5.0 * (t > 0.5)])


def equals(capture, truth, within=2e-7):
    """A C3D file holds 32 bits, of which the walk along 1.6 m leaves 1e-7 m."""
    assert set(capture.markers) == set(truth)
    for name, place in truth.items():
        np.testing.assert_allclose(capture.markers[name], place, rtol=0.0, atol=within)


def test_markers_analog_signals_and_events_come_back(tmp_path, truth):
    capture = io.read_c3d(write(tmp_path / "walk.c3d", truth))
    equals(capture, truth)
    assert (capture.rate_hz, capture.up, capture.name, capture.subject) == (RATE, "+z", "walk", "subject")
    np.testing.assert_allclose(capture.time, (FIRST - 1 + np.arange(SAMPLES)) / RATE)
    assert (capture.analog_rate_hz, capture.analog_units) == (PER_FRAME * RATE, {"Fz1": "N", "Trigger": "V"})
    np.testing.assert_allclose(np.stack(list(capture.analog.values())), analog(), rtol=1e-6)
    np.testing.assert_allclose(capture.analog_time, 0.5 + np.arange(1200) / 1000.0)
    assert [(event.kind, event.side) for event in capture.events] == [
        ("initial_contact", "right"), ("final_contact", "left"), ("Clap", None),
    ]  # fmt: skip
    np.testing.assert_allclose([event.time for event in capture.events], [0.7, 0.9, 61.25], rtol=1e-6)
    assert "+z points up by POINT:Y_SCREEN" in texts(capture.notes)
    assert list(capture.force_plates["USED"]) == [0]


@pytest.mark.parametrize("up", list(UPRIGHT))
def test_any_axis_may_point_up(tmp_path, truth, up):
    """Turned so that z is up, by what the file says, and where it is silent by pelvis and feet."""
    turn = UPRIGHT[up]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3))
    np.testing.assert_allclose(np.linalg.det(turn), 1.0)
    turned = {name: place @ turn for name, place in truth.items()}
    for screen in (up.upper(), None):
        capture = io.read_c3d(write(tmp_path / "turned.c3d", turned, screen=screen))
        assert capture.up == up
        equals(capture, truth)
    assert any("trunk's markers are above the feet's" in note for note in texts(capture.notes))


def cast(markers):
    """The markers by the names of the CAST protocol, as Qualisys has them."""
    names = {"ASI": "IAS", "PSI": "IPS", "HEE": "FCC", "TOE": "FM5"}
    return {f"{name[0]}_{names[name[1:]]}": place for name, place in markers.items() if name[1:] in names}


@pytest.mark.parametrize("names", [dict, cast, lambda markers: {f"m{i}": p for i, p in enumerate(markers.values())}])
def test_markers_overrule_the_axes_of_a_screen(tmp_path, truth, names):
    """Qualisys states a vertical that may point down; without known names, a body below the floor shows it."""
    markers = {name: place - [1.0, 0.0, 0.0] for name, place in names(truth).items()}
    capture = io.read_c3d(write(tmp_path / "screen.c3d", markers, screen="-Z"))
    assert capture.up == "+z"
    equals(capture, markers)
    assert any(
        text.startswith("+z points up, for ") and "states -z: pass up='-z'" in text for text in texts(capture.notes)
    )
    with_names = all(name[0] in "RL" for name in markers)
    for screen in ("+Y", "+X"):
        capture = io.read_c3d(write(tmp_path / "odd.c3d", markers, screen=screen))
        assert capture.up == ("+z" if with_names else screen.lower())
    lying = io.read_c3d(tmp_path / "odd.c3d", up="+x")
    assert lying.up == "+x"


def test_more_frames_than_the_header_holds(tmp_path, monkeypatch, truth):
    path = write(tmp_path / "long.c3d", truth)
    file = ezc3d.c3d(str(path))
    file.add_parameter("TRIAL", "ACTUAL_START_FIELD", [1, 0])
    file.add_parameter("TRIAL", "ACTUAL_END_FIELD", [70_000 & 0xFFFF, 70_000 >> 16])
    file.write(str(path))
    equals(io.read_c3d(path), truth)  # a trial that was cut
    monkeypatch.setattr("jgait.io.formats.c3d.MOST_FRAMES", SAMPLES)
    with pytest.raises(
        RecordingError, match="long.c3d holds 70000 frames, by TRIAL:ACTUAL_END_FIELD, of which ezc3d re"
    ):
        io.read_c3d(path)


def test_what_was_not_seen_is_nan_and_outputs_of_a_model_are_kept_apart(tmp_path, truth):
    lost = {f"Ann:{name}": place.copy() for name, place in truth.items()}
    lost["Ann:RHEE"][10:20] = np.nan
    lost["Ann:LTOE"][30] = 0.0
    angles = {"Ann:RKneeAngles": np.full((SAMPLES, 3), 61.0), "Ann:Scale": np.full((SAMPLES, 3), 2.0)}
    capture = io.read_c3d(write(tmp_path / "lost.c3d", lost, outputs=angles))
    assert capture.subject == "Ann" and set(capture.outputs) == {"RKneeAngles", "Scale"}
    assert (capture.outputs["RKneeAngles"] == 61.0).all()
    assert list(np.flatnonzero(np.isnan(capture.markers["RHEE"]).all(axis=1))) == list(range(10, 20))
    assert list(np.flatnonzero(np.isnan(capture.markers["LTOE"]).any(axis=1))) == [30]


@pytest.mark.parametrize("unit, factor", [("mm", 1e3), ("m", 1.0), ("cm", 1e2), ("in", 1.0 / 0.0254)])
def test_units_are_those_of_the_file_or_of_the_size_of_a_person(tmp_path, truth, unit, factor):
    equals(io.read_c3d(write(tmp_path / "unit.c3d", truth, units=unit, factor=factor)), truth)
    path = write(tmp_path / "none.c3d", truth, units="", factor=factor)
    if unit in ("mm", "m"):
        assert f"states no unit of its markers; {unit}" in str(texts(io.read_c3d(path).notes))
    else:
        with pytest.raises(RecordingError, match="states no unit of its markers, and their distance, "):
            io.read_c3d(path)
    equals(io.read_c3d(path, unit=unit), truth)


def test_names_that_tell_nothing_leave_the_floor_or_nothing(tmp_path, truth):
    for height, up, said in ((0.0, "+z", "above a floor at 0"), (3.0, None, "neither the file nor its markers show")):
        markers = {f"m{i}": place + [-1.0, 0.0, height] for i, place in enumerate(truth.values())}
        capture = io.read_c3d(write(tmp_path / "floor.c3d", markers, screen=None))
        assert capture.up == up and said in str(texts(capture.notes))
        equals(capture, markers, 5e-7)
