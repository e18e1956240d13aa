"""A sampling rate that only a user states is uncertain, and with it every length; time stamps measure it."""

import jax
import numpy as np
import pytest
from made.notes import texts

import jgait
from experiments.damage import harm
from jgait import io, simulate
from jgait.estimators import foot_ins
from jgait.io.clock import TIME_SPREAD
from jgait.quality.model import LENGTH_BY_TIME
from jgait.simulate.sensors import OPAL
from jgait.types import as_float

SHARE = LENGTH_BY_TIME * TIME_SPREAD


@pytest.fixture(scope="module")
def rows():
    placements = ("foot_right", "foot_left", "pelvis")
    ((recording, _),) = simulate.cohort(
        jax.random.key(4), 1, simulate.straight(12.0), OPAL, 100.0, placements, recorded=False
    )
    return harm.rows_of(recording, placements)


def by_rate(rows, factor=1.0):
    return harm.called(factor).change(rows, "", None)


def spread_of(recording):
    return {facts.time_spread for facts in recording.quality.values()}


def test_only_a_rate_that_a_user_states_is_uncertain(rows, tmp_path):
    stamped, stated = harm.read(rows, "stamped"), harm.read(by_rate(rows), "stated")
    assert spread_of(stamped) == {0.0} and spread_of(stated) == {TIME_SPREAD}
    (note,) = (note for note in stated.notes if "no time stamps" in note.text)
    assert note.severity == "info" and "100 Hz" in note.text and "no time stamps" not in texts(stamped.notes)
    gyr, acc = rows.sensors["foot_right"]["gyr"], rows.sensors["foot_right"]["acc"]
    known = np.isfinite(gyr).all(axis=1)
    table = np.hstack([gyr, acc])[known]
    path = tmp_path / "foot_right.csv"
    np.savetxt(path, table, delimiter=",", header="gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z", comments="")
    read = io.read(path, sampling_rate_hz=100.0, placement="foot_right", gyr_unit="deg/s", acc_unit="m/s^2")
    assert spread_of(read) == {TIME_SPREAD}


def test_lengths_and_the_distance_of_one_estimator_get_the_deviation_of_the_rate(rows):
    stamped, stated = (
        foot_ins.estimate(foot_ins.FootParams(), harm.read(each, "walk")) for each in (rows, by_rate(rows))
    )
    length = as_float(stamped.strides.length)
    np.testing.assert_allclose(as_float(stated.strides.length), length, atol=2e-3)
    expected = np.hypot(as_float(stamped.strides_stddev.length), SHARE * length)
    np.testing.assert_allclose(as_float(stated.strides_stddev.length), expected, rtol=0.05)
    before, after = (as_float(each.diagnostics["distance_stddev"])[-1] for each in (stamped, stated))
    assert after == pytest.approx(np.hypot(before, SHARE * as_float(stamped.distance)[-1]), rel=0.05)


def test_the_sources_of_one_walk_share_the_deviation_of_the_rate(rows):
    stamped, wrong = (jgait.analyse(harm.read(each, "walk"), {"height": 1.75}) for each in (rows, by_rate(rows, 1.03)))
    way, stated = (as_float(each.estimate.distance)[-1] for each in (stamped, wrong))
    spread = as_float(wrong.estimate.diagnostics["distance_stddev"])[-1]
    assert spread >= SHARE * stated  # more sources do not make the time more certain
    assert 0.05 * way < abs(way - stated) < 3.0 * spread
