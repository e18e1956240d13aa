"""Sensors on the legs that are put on while they record: neither their angles nor their strides are of walking then."""

import jax
import numpy as np
import pytest
from made.handled import HELD_S, STANDS_S, put_on
from made.notes import codes, of_code

import jgait
from jgait import simulate
from jgait.estimators.combined.compare import regular
from jgait.simulate.sensors import OPAL
from jgait.types import as_float

LIES_S = 4.0
PERSON = {"height": 1.75}


@pytest.fixture(scope="module")
def walked():
    ((recording, _),) = simulate.cohort(
        jax.random.key(4), 1, simulate.straight(12.0), OPAL, 100.0, simulate.FOUR, recorded=False
    )
    return recording, jgait.analyse(recording, PERSON)


@pytest.mark.parametrize(("late", "seed"), [(simulate.FOUR, 0), (("thigh_left",), 1)])
def test_sensors_that_are_put_on_late_measure_the_walk(walked, late, seed):
    """Hip and knee angles of the whole walk were said to be not usable, and a hand took strides."""
    recording, plain = walked
    rate = recording.sampling_rate_hz
    still = {"turns": 0.0, "shakes": 0.0}
    sensors = {
        name: put_on(imu, rate, lies_s=LIES_S, seed=10 * seed + number, **({} if name in late else still))
        for number, (name, imu) in enumerate(recording.sensors.items())
    }
    found = jgait.analyse(recording._replace(sensors=sensors), PERSON)
    assert "knee_implausible" not in codes(found.notes) and "angles_doubtful" not in codes(found.notes)
    before = LIES_S + HELD_S + STANDS_S
    steps = before + float(as_float(plain.strides.strides.start).min())
    assert all(note.values["to_s"] < steps for note in of_code(found.notes, "not_worn"))
    for side in ("right", "left"):
        ours, theirs = (getattr(one.estimate.legs, side) for one in (found, plain))
        later = as_float(found.estimate.time) > before + 1.0
        known = as_float(theirs.knee_angle)[-later.sum() :]
        assert np.nanmedian(np.abs(np.rad2deg(as_float(ours.knee_angle)[later] - known))) < 3.0
    begun = as_float(found.strides.strides.start)
    assert (begun > before).sum() == len(plain.strides.first)
    assert not (regular(found.strides) & (begun < before)).any()
    ends = [float(one.estimate.distance[-1]) for one in (found, plain)]
    assert abs(ends[0] - ends[1]) < 2.0 * float(found.estimate.diagnostics["distance_stddev"][0])
