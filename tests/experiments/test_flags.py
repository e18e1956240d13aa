"""Flags of strides and trials are counted as documented."""

import numpy as np
import pytest


def test_missed_and_false_flags_are_counted(load_experiment):
    flags = load_experiment("unseen.flags")
    one = flags.Judged("set", "a", np.array([0.5, 4.0, 5.0, 2.0]), np.array([False, True, False, True]))
    other = flags.Judged("set", "b", np.array([1.0, 1.0]), np.array([False, False]))
    told = {row.metric: row.value for row in flags.of_strides([one, other])}
    assert told["flags_missed_pct"] == pytest.approx(100.0 / 6.0)  # one of six
    assert told["flags_false_pct"] == pytest.approx(100.0 / 4.0)  # one of the four good ones
    assert told["flags_missed_pct_even"] == pytest.approx(25.0) and told["flags_missed_pct_odd"] == 0.0
    assert told["within_two_sigma_pct_set"] == pytest.approx(100.0 * 4.0 / 6.0)


def test_a_trial_is_off_beyond_half_a_metre_or_three_deviations(load_experiment):
    flags = load_experiment("unseen.flags")
    trials = [
        flags.Trial("far", 0.6, 1.0, True), flags.Trial("unsure", 0.4, 0.1, False),
        flags.Trial("good", 0.2, 0.1, False), flags.Trial("best", 0.1, 0.1, True),
    ]  # fmt: skip
    told = {row.metric: row.value for row in flags.of_trials(trials)}
    assert told["trials_missed"] == 1.0 and told["trials_false"] == 1.0
