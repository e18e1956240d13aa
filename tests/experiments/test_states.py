"""Pictures of a shank show the state machine as it runs, and a stride as long as it is."""

import numpy as np
import pytest
from made.shank import LEAN, SWING, shank

from experiments.silva2017 import states
from jgait import plot
from jgait.events import shank as shank_events


@pytest.fixture(scope="module")
def made():
    return shank(strides=3, length=[1.0, 1.2, 1.1], rises=[0.0, 0.15, 0.0])


def test_states_events_and_thresholds(made, tmp_path):
    figure = states.swing_states(made.recording, seconds=(0.0, 6.0), title="made")
    above, below = figure.axes
    assert "[rad/s]" in above.get_ylabel() and [t.get_text() for t in below.get_yticklabels()] == [
        s[1] for s in states.STATES
    ]
    (raw,) = [
        m for m in above.lines if m.get_color() == states.RAW["color"] and m.get_linewidth() == states.RAW["linewidth"]
    ]
    assert raw.get_ydata().min() == pytest.approx(-2.0 * LEAN / SWING, rel=0.05)
    level = [m.get_ydata()[0] for m in above.lines if m.get_linestyle() == "--"]
    np.testing.assert_allclose(np.abs(level), shank_events.MACHINE.threshold)
    marks = {m.get_marker(): m for m in above.lines if m.get_marker() in ("^", "D", "v")}
    rate = made.recording.sensors["shank_right"].gyr[:, 1]
    found = shank_events.phases(rate, 100.0)
    there = np.flatnonzero(np.asarray(found.stride))
    assert there.size == 3
    for marker, field in (("^", "push_off"), ("D", "start"), ("v", "end")):
        np.testing.assert_allclose(marks[marker].get_xdata(), np.asarray(getattr(found, field))[there], atol=1e-6)
    np.testing.assert_allclose(marks["D"].get_ydata(), 0.0, atol=0.05)  # where the filtered rate crosses zero
    (line,) = below.lines
    state = np.asarray(line.get_ydata())
    assert np.sum((state[:-1] == shank_events.SWING) & (state[1:] == shank_events.HEEL_STRIKE)) == 3
    (filtered,) = [m for m in above.lines if m.get_linewidth() == states.FILTERED["linewidth"]]
    np.testing.assert_array_less(filtered.get_ydata()[state == shank_events.SWING][3:-3], 0.2)
    assert plot.save(figure, tmp_path / "states.png").stat().st_size > 20_000
    strict = shank_events.PAPER._replace(threshold=10.0)
    none = states.swing_states(made.recording, detector=strict, seconds=(0.0, 6.0)).axes[0]
    assert not any(m.get_xdata().size for m in none.lines if m.get_marker() in ("^", "D", "v"))
