"""Pictures of a trunk show its accelerations, contacts by side, and speeds by every way; the command line writes them.

Accelerations are sines, so that they are known; the estimate is made by hand: contacts at the forward maxima.
"""

import jax
import numpy as np
import pytest

from jgait import plot
from jgait.commands import jobs
from jgait.estimators import waist
from jgait.estimators.about import EstimatedRecording
from jgait.estimators.waist.about import ABOUT
from jgait.plot.style import FOOTHOLD
from jgait.plot.waist import CONTACT, RAW, REBUILT
from jgait.types import SIDES, Estimate, Imu, Legs, Recording, Strides

HZ, SECONDS, STAND = 50.0, 10.0, 2.5
STEPS_HZ, SURGE, HEAVE = 1.8, 1.5, 2.5
SPEED = 1.2


@pytest.fixture(scope="module")
def recording():
    time = np.arange(round(SECONDS * HZ)) / HZ
    walks = np.clip((time - STAND) * 2.0, 0.0, 1.0)
    phase = 2.0 * np.pi * STEPS_HZ * (time - STAND)
    acc = np.stack([SURGE * np.sin(phase), 0.8 * np.sin(0.5 * phase), -HEAVE * np.cos(phase)], axis=1)
    acc = walks[:, None] * acc + np.array([0.0, 0.0, 9.80665])
    yaw = 0.5 * walks * np.cos(0.5 * phase)
    gyr = np.stack([np.zeros_like(yaw), np.zeros_like(yaw), yaw], axis=1)
    return Recording({"waist": Imu(time, gyr, acc, np.ones(time.size, bool))}, HZ, "sines")


@pytest.fixture(scope="module")
def estimate(recording):
    time = recording.sensors["waist"].time
    contact = STAND + (0.25 + np.arange(2, 12)) / STEPS_HZ
    side = np.arange(contact.size) % 2
    told = {"initial_contact": contact, "initial_contact_side": side, "notes": ()}
    way = SPEED * np.clip(time - contact[0], 0.0, None)
    n = contact.size - 2
    nothing = np.full(n, np.nan)
    strides = Strides(side[2:], contact[:-2], nothing, contact[2:], np.full(n, 1.3), nothing, nothing, np.ones(n, bool))
    told["trunk_acceleration"] = recording.sensors["waist"].acc - [0.0, 0.0, 9.80665]
    return Estimate(time, Legs(None, None), None, way, np.ones(time.size, bool), told, strides)


def lines_of(axis, style):
    return [line for line in axis.lines if line.get_color() == style["color"] and line.get_marker() == "None"]


def test_contacts_over_what_the_trunk_feels(recording, estimate, tmp_path):
    figure = plot.trunk_contacts(estimate, title="sines")
    assert [axis.get_ylabel() for axis in figure.axes] == ["forward [m/s²]", "upward [m/s²]", "to the left [m/s²]"]
    when, side = (estimate.diagnostics[name] for name in ("initial_contact", "initial_contact_side"))
    first, last = figure.axes[0].get_xlim()
    assert last - first == pytest.approx(4.0)
    seen = (when >= first) & (when <= last)
    for axis, height in zip(figure.axes, (SURGE, HEAVE, 0.8), strict=True):
        (raw,) = lines_of(axis, RAW)
        assert raw.get_ydata().max() == pytest.approx(height, rel=0.15)
        rebuilt = max((len(line.get_xdata()), line) for line in lines_of(axis, REBUILT))[1]
        assert np.abs(rebuilt.get_ydata()).max() < 0.3 * height  # a slow sine has little in its finest details
        for number, name in enumerate(SIDES):
            own = when[seen & (side == number)]
            (marks,) = [m for m in axis.lines if m.get_marker() == FOOTHOLD[name]["marker"]]
            np.testing.assert_allclose(marks.get_xdata(), own)
            upright = [m for m in lines_of(axis, CONTACT[name]) if len(m.get_xdata()) == 2]
            np.testing.assert_allclose([m.get_xdata()[0] for m in upright], own)
    (marks,) = [m for m in figure.axes[0].lines if m.get_marker() == "o"]
    assert marks.get_ydata().min() > 0.7 * SURGE  # right where they were put: at the forward maxima
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(words) == len(set(words)) and {"interval of interest", "right contact"} <= {*words}
    assert plot.save(figure, tmp_path / "contacts.png").stat().st_size > 20_000


def test_speed_with_the_velocity_update(load_experiment, recording, estimate):
    drawing = load_experiment("kose2011.speed")
    reference = estimate._replace(distance=0.5 * estimate.distance, valid=estimate.time < 7.0)
    figure = drawing.forward_speed(recording, estimate, reference=reference, seconds=(2.0, 9.5))
    _, speed, way = figure.axes
    assert [axis.get_ylabel() for axis in (speed, way)] == ["speed [m/s]", "way [m]"]
    (line,) = [m for m in speed.lines if m.get_color() == drawing.OURS["color"]]
    np.testing.assert_allclose(line.get_ydata(), SPEED, atol=0.02)
    rising = [m.get_ydata() for m in way.lines if len(m.get_xdata()) > 100]
    assert len(rising) == 3 and all(values[0] == 0.0 for values in rising)


def test_without_contacts_the_command_line_draws_none(recording, estimate, tmp_path):
    p = waist.with_body(waist.WaistParams(), {"sensor_height": 0.97})
    for count, files in ((10, ["walk_contacts.png"]), (0, [])):
        contacts = {
            f"initial_contact{end}": estimate.diagnostics[f"initial_contact{end}"][:count] for end in ("", "_side")
        }
        contacts |= {"initial_contact_side_probability": np.ones(count), "distance_stddev": 0.02 * estimate.distance}
        strides = jax.tree.map(lambda column, n=count: column[:n], estimate.strides)
        found = estimate._replace(diagnostics=estimate.diagnostics | contacts, strides=strides)
        made = EstimatedRecording(recording, found, p, {"options": waist.DEFAULT})
        written = jobs.of_estimate(made, ABOUT).drawn(tmp_path, "walk", ABOUT.figures)
        assert [path.name for path in written if "contacts" in path.name] == files


def test_what_is_not_there_is_refused(estimate):
    with pytest.raises(ValueError, match="has no initial contacts at the trunk"):
        plot.trunk_contacts(estimate._replace(diagnostics={}))
    with pytest.raises(ValueError, match="no initial contact to draw"):
        plot.trunk_contacts(estimate._replace(diagnostics={"initial_contact": [], "initial_contact_side": []}))
