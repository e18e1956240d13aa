"""A walker is fitted to a recording: it moves as the person did, and other sensors on it read what they would have."""

import jax
import numpy as np
import pytest

from experiments.common.fitting import (
    StrideSignals,
    fitted,
    mean_strides,
    unexplained,
    virtual,
)
from experiments.people.fitted import OTHERS, usual
from jgait import simulate
from jgait.simulate.sensors import OPAL

pytestmark = pytest.mark.release


def lengths(body):
    return {"thigh_length": float(body.thigh_length), "shank_length": float(body.shank_length)}


def shares(person, seen, late=0.0):
    """Mean unexplained share of rates and of forces of other sensors, in a stride that begins late [s]."""
    made = virtual(person, tuple(seen), late / float(person.gait.stride_time))
    both = (StrideSignals(*(np.stack([getattr(one[name], kind) for name in seen]) for kind in StrideSignals._fields))
            for one in (made, seen))  # fmt: skip
    return np.sqrt(np.asarray(unexplained(*both)[0])).mean(axis=1)


@pytest.fixture(scope="module")
def someone():
    """A simulated person with a style of their own, worn legs in unknown orientations, and the fit."""
    drawn = simulate.person_of(simulate.population(jax.random.key(40), 1, recorded=True), 0)
    along, key = simulate.straight(12.0), jax.random.key(3)
    who = simulate.covering(key, drawn, along)
    recording, _ = simulate.recording(key, who, along, OPAL, placements=simulate.FOUR)
    return who, fitted(recording, lengths(who.body))


def test_a_walker_is_recovered_from_sensors_on_the_legs(someone):
    who, fit = someone
    own, found = who.gait, fit.person.gait
    assert fit.person.body[:2] == pytest.approx(who.body[:2])
    assert found.stride_time == pytest.approx(own.stride_time, rel=0.02)
    assert found.stride_length == pytest.approx(own.stride_length, rel=0.03)
    assert found.steps == pytest.approx(own.steps, abs=2.0)
    assert found.toe_up == pytest.approx(own.toe_up, rel=0.15)
    assert found.heel_up == pytest.approx(own.heel_up, rel=0.08)
    styles = [[getattr(gait, f"style_{i}") for i in range(1, 5)] for gait in (own, found)]
    assert np.corrcoef(*styles)[0, 1] > 0.8
    assert not fit.notes
    for name in simulate.FOUR:
        assert fit.unexplained[name].gyr < 0.7 * fit.usual[name].gyr
        assert fit.unexplained[name].acc < 0.6 * fit.usual[name].acc
        assert np.linalg.det(fit.axes[name]) == pytest.approx(1.0)


def test_other_sensors_of_the_fitted_walker_read_what_they_would_have(someone):
    who, fit = someone
    seen = virtual(who, OTHERS)
    # A walker who begins with the other foot is half a stride later.
    late = 0.5 * fit.person.gait.stride_time * (fit.person.gait.right_first != who.gait.right_first)
    ours, theirs = shares(fit.person, seen, late), shares(usual(fit), seen, late)
    assert np.all(ours < 0.15)
    assert np.all(ours < 0.7 * theirs)
    read, _ = simulate.recording(jax.random.key(0), fit.person, placements=OTHERS)
    assert all(np.isfinite(imu.acc).all() for imu in read.sensors.values())


def test_ankles_of_a_recorded_person_are_predicted_from_thighs_and_shanks(data):
    """Forces better than by the usual walker of this stride, rates as well; errors are large, and a note says so."""
    (walk,) = data("neura_sparse")
    sensors, body = walk.recording.sensors, np.mean(list(walk.info["lengths"].values()), axis=0)
    legs = walk.recording._replace(sensors={name: sensors[name] for name in simulate.FOUR})
    fit = fitted(legs, dict(zip(("thigh_length", "shank_length"), body, strict=True)))
    ankles = walk.recording._replace(sensors={name: sensors[name] for name in OTHERS[:2]})
    seen = mean_strides(ankles, fit.strides)
    (rate, force), (rate_usual, force_usual) = (shares(one, seen, fit.late) for one in (fit.person, usual(fit)))
    assert rate < min(0.5, rate_usual + 0.05)
    assert force < force_usual
    assert {note.code for note in fit.notes} == {"walker_fits_poorly"}
