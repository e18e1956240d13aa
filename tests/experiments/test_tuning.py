"""The tuning experiment finds the noise that made the data, and says which noise the data cannot tell."""

import pytest

from experiments.tuning import noise as experiment
from experiments.tuning import walking5m as real

pytestmark = pytest.mark.release


def test_likelihood_finds_what_is_there_and_names_what_is_not(capsys):
    rows = {row.metric: row for row in experiment.rows(quick=True)}
    assert rows["recover_noise_rel_error_max"].value < 0.2
    assert rows["recover_noise_rel_error_max"].split.endswith("angle_noise, gyro_variance")
    assert rows["recover_noise_unidentifiable_named"].value == 1.0
    # Judged on legs that the tuning never saw.
    assert not rows["nis_inside_before"].value
    assert rows["nis_people_inside_before"].value == 0.0
    assert rows["nis_people_inside_after"].value > 0.6
    assert rows["white_people_before"].value < 0.5 < rows["white_people_after"].value
    assert "position_noise is not determined by these data" in capsys.readouterr().out


def test_a_person_whose_scale_is_off_is_found_by_the_read_out():
    """Two legs that go back and forth by a metre a second: the distance is theirs, times the scale."""
    import numpy as np

    from jgait.types import Legs, LegTrajectory

    t = np.arange(400) / 100.0
    saw = np.abs((t % 2.0) - 1.0)
    legs = Legs(*(LegTrajectory(0.0 * t, 0.0 * t, x, 0.0 * t) for x in (saw, 1.0 - saw)))
    item = real.Walked(legs, np.zeros(t.size, bool), np.asarray(4.0 * (t.size - 1) / t.size))
    assert float(real.percent(real.ReadOut(1.0, 0.07), item)) == pytest.approx(0.0, abs=0.5)
    assert float(real.percent(real.ReadOut(1.1, 0.07), item)) == pytest.approx(10.0, abs=0.5)
