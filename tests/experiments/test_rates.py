"""Rates of a gyroscope with and without sleep."""

import numpy as np
import pytest

from experiments.udaya2010 import rates
from jgait import plot
from jgait.types import Estimate, Legs


@pytest.fixture
def slept():
    """A shank whose gyroscope sleeps from 2 to 4 s; there the filter's rate is a tenth too large."""
    time = np.arange(500) / 50.0
    rate, how = np.sin(2.0 * np.pi * time), np.where((time >= 2.0) & (time < 4.0), 1, 0)
    awake = Estimate(time, Legs(None, None), None, None, np.ones(500, bool), {
        "rate_shank_left": rate, "gyro_shank_left": rate + 0.01, "how_shank_left": 0 * how})  # fmt: skip
    told = {**awake.diagnostics, "rate_shank_left": np.where(how, 1.1 * rate, rate), "how_shank_left": how}
    return awake._replace(diagnostics=told), awake


def test_rates_with_and_without_sleep(slept, tmp_path):
    asleep, awake = slept
    figure = rates.filtered_rates(asleep, awake, seconds=(2.0, 3.98))
    above, error = figure.axes
    assert above.get_ylabel() == "shank, left\nrate [rad/s]" and error.get_ylabel() == "error [rad/s]"
    assert len(above.patches) == 1 and len(error.patches) == 1
    assert error.get_title(loc="right") == "root mean square 10 % of the rate's"
    np.testing.assert_allclose(error.lines[1].get_ydata(), 0.1 * above.lines[0].get_ydata(), atol=1e-12)
    (alone,) = rates.filtered_rates(awake, placement="shank_left").axes
    np.testing.assert_allclose(alone.lines[0].get_ydata() - alone.lines[1].get_ydata(), 0.01, atol=1e-12)
    assert not alone.patches
    assert plot.save(figure, tmp_path / "rates.png").stat().st_size > 20_000
