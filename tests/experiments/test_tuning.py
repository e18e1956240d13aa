"""The tuning experiment finds the noise that made the data, and says which noise the data cannot tell."""

import pytest

from experiments.tuning import noise as experiment

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
