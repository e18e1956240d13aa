"""Pictures of a trunk show its accelerations and its contacts by side.

Accelerations are sines, so that they are known; the estimate is made by hand: contacts at the forward maxima.
"""

import numpy as np
import pytest

from jgait import plot
from jgait.plot.style import FOOT, FOOTHOLD
from jgait.types import SIDES, Estimate, Legs, Strides

HZ, SECONDS, STAND = 50.0, 10.0, 2.5
STEPS_HZ, SURGE, HEAVE = 1.8, 1.5, 2.5
SPEED = 1.2


@pytest.fixture(scope="module")
def estimate():
    time = np.arange(round(SECONDS * HZ)) / HZ
    phase = 2.0 * np.pi * STEPS_HZ * (time - STAND)
    acc = np.stack([SURGE * np.sin(phase), 0.8 * np.sin(0.5 * phase), -HEAVE * np.cos(phase)], axis=1)
    acc = np.clip((time - STAND) * 2.0, 0.0, 1.0)[:, None] * acc
    contact = STAND + (0.25 + np.arange(2, 12)) / STEPS_HZ
    side = np.arange(contact.size) % 2
    told = {"initial_contact": contact, "initial_contact_side": side, "notes": (), "trunk_acceleration": acc}
    way = SPEED * np.clip(time - contact[0], 0.0, None)
    n = contact.size - 2
    nothing = np.full(n, np.nan)
    strides = Strides(side[2:], contact[:-2], nothing, contact[2:], np.full(n, 1.3), nothing, nothing, np.ones(n, bool))
    return Estimate(time, Legs(None, None), None, way, np.ones(time.size, bool), told, strides)


def lines_of(axis, color):
    return [line for line in axis.lines if line.get_color() == color and line.get_marker() == "None"]


def test_contacts_over_what_the_trunk_feels(estimate, tmp_path):
    figure = plot.trunk_contacts(estimate, title="sines")
    assert [axis.get_ylabel() for axis in figure.axes] == ["forward [m/s²]", "upward [m/s²]", "to the left [m/s²]"]
    when, side = (estimate.diagnostics[name] for name in ("initial_contact", "initial_contact_side"))
    first, last = figure.axes[0].get_xlim()
    assert last - first == pytest.approx(4.0)
    seen = (when >= first) & (when <= last)
    for axis, height in zip(figure.axes, (SURGE, HEAVE, 0.8), strict=True):
        (raw,) = lines_of(axis, "0.6")
        assert raw.get_ydata().max() == pytest.approx(height, rel=0.15)
        rebuilt = max((len(line.get_xdata()), line) for line in lines_of(axis, "black"))[1]
        assert np.abs(rebuilt.get_ydata()).max() < 0.3 * height  # a slow sine has little in its finest details
        for number, name in enumerate(SIDES):
            own = when[seen & (side == number)]
            (marks,) = [m for m in axis.lines if m.get_marker() == FOOTHOLD[name]["marker"]]
            np.testing.assert_allclose(marks.get_xdata(), own)
            upright = [m for m in lines_of(axis, FOOT[name]["color"]) if len(m.get_xdata()) == 2]
            np.testing.assert_allclose([m.get_xdata()[0] for m in upright], own)
    (marks,) = [m for m in figure.axes[0].lines if m.get_marker() == "o"]
    assert marks.get_ydata().min() > 0.7 * SURGE  # right where they were put: at the forward maxima
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(words) == len(set(words)) and {"interval of interest", "right contact"} <= {*words}
    assert plot.save(figure, tmp_path / "contacts.png").stat().st_size > 20_000


def test_what_is_not_there_is_refused(estimate):
    with pytest.raises(ValueError, match="has no initial contacts at the trunk"):
        plot.trunk_contacts(estimate._replace(diagnostics={}))
    with pytest.raises(ValueError, match="no initial contact to draw"):
        plot.trunk_contacts(estimate._replace(diagnostics={"initial_contact": [], "initial_contact_side": []}))
