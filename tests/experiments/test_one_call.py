"""The mistakes that the experiment makes are mistakes, and its scores count what they say."""

import jax
import numpy as np
import pytest

from experiments.one_call import lengths, mistakes
from jgait import simulate
from jgait.estimators.combined import crosscheck
from jgait.simulate.sensors import OPAL


@pytest.fixture(scope="module")
def recording():
    return next(iter(simulate.cohort(jax.random.key(8), 1, simulate.straight(10.0), OPAL, 100.0, recorded=False)))[0]


def test_every_mistake_changes_the_recording_and_is_named(recording):
    chooser = np.random.default_rng(0)
    for kind in mistakes.MISTAKES:
        wrong, code, placements = mistakes.spoilt(recording, kind, chooser)
        changed = [
            name for name, imu in recording.sensors.items()
            if not np.array_equal(imu.gyr, wrong.sensors[name].gyr)
            or not np.array_equal(imu.acc, wrong.sensors[name].acc)
        ]  # fmt: skip
        assert len(changed) == (2 if kind in ("sides exchanged", "thigh for shank") else 1)
        assert mistakes.named(crosscheck(wrong).notes, code, placements)
        assert not mistakes.named((), code, placements)


def test_the_score_is_of_strides_that_all_sources_have():
    one = {
        "feet": np.array([0.02, 0.01, np.nan, 0.1]), "ankles": np.array([-0.04, 0.01, 0.0, 0.1]),
        "shanks": np.array([0.03, 0.01, 0.0, 0.1]), "waist": np.array([0.2, np.nan, 0.1, 0.1]),
        "combined": np.array([0.01, 0.01, 0.0, 0.1]), "stddev": np.full(4, 0.01),
        "turning": np.array([0.0, 0.0, 0.0, 1.0]),
    }  # fmt: skip
    straight = lengths.score([one], straight=True)
    assert straight["n"] == 2
    np.testing.assert_allclose([straight["combined"], straight["feet"], straight["nees"]], [1.0, 1.5, 1.0])
    np.testing.assert_allclose(lengths.over_best(straight), 1.0 / 1.5)
    assert lengths.score([one], straight=False)["n"] == 3
