"""Flags of strides and trials are counted as documented."""

import numpy as np
import pytest

from experiments.unseen import asymmetry, flags
from experiments.unseen import trials as trials_part

LENGTHS = np.ones((2, 4))
"""[m] Of the estimate and of the reference, where they do not matter."""


def test_missed_and_false_flags_are_counted():
    one = flags.Judged(
        "set", "a", np.array([0.5, 4.0, 5.0, 2.0]), np.array([False, True, False, True]), *LENGTHS[:, :4]
    )
    other = flags.Judged("set", "b", np.array([1.0, 1.0]), np.array([False, False]), *LENGTHS[:, :2])
    told = {row.metric: row.value for row in flags.of_strides([one, other])}
    assert told["flags_missed_pct"] == pytest.approx(100.0 / 6.0)  # one of six
    assert told["flags_false_pct"] == pytest.approx(100.0 / 4.0)  # one of the four good ones
    assert told["flags_missed_pct_even"] == pytest.approx(25.0) and told["flags_missed_pct_odd"] == 0.0
    assert told["within_two_sigma_pct_set"] == pytest.approx(100.0 * 4.0 / 6.0)


def test_a_trial_is_off_beyond_half_a_metre_or_three_deviations():
    trials = [
        trials_part.Trial("far", 0.6, 1.0, True), trials_part.Trial("unsure", 0.4, 0.1, False),
        trials_part.Trial("good", 0.2, 0.1, False), trials_part.Trial("best", 0.1, 0.1, True),
    ]  # fmt: skip
    told = {row.metric: row.value for row in trials_part.of_trials(trials)}
    assert told["trials_missed"] == 1.0 and told["trials_false"] == 1.0


def test_asymmetries_within_two_stated_deviations_are_counted():
    found = [asymmetry.Asymmetry("stance", 1.0, 2.0, 3.0, 2.0), asymmetry.Asymmetry("stance", 1.0, 9.0, 3.0, 3.0)]
    told = {row.metric: row.value for row in asymmetry.of_walks(found)}
    assert told == {
        "stance_bias": 2.5, "asymmetry_stance_points": 4.5, "asymmetry_stance_within_two_sigma_pct": 50.0
    }  # fmt: skip
