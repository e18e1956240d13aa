"""A shoe's sensor that was put on anew leans otherwise in stance."""

import jax
import numpy as np
import pytest
from made.notes import of_code
from made.trunk import worn
from scipy.spatial.transform import Rotation

from jgait import simulate
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootParams
from jgait.simulate.sensors import OPAL


def pause_of(truth):
    ends = np.sort(truth.strides.end[np.asarray(truth.strides.valid)])
    return ends[np.argmax(np.diff(ends))] + 2.5


@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_a_sensor_that_was_put_on_anew_is_named_and_one_that_stays_is_not(degrees):
    person = simulate.person_of(simulate.population(jax.random.key(3), 1, recorded=False), 0)
    walked, truth = simulate.with_breaks(
        jax.random.key(4), person, [simulate.straight(15.0)] * 2, [5.0], OPAL, placements=("foot_right",)
    )
    imu = walked.sensors["foot_right"]
    at = pause_of(truth)
    turn, later = Rotation.from_euler("x", degrees, degrees=True), (imu.time > at)[:, None]
    gyr, acc = (np.where(later, turn.apply(values), values) for values in (imu.gyr, imu.acc))
    found = foot_ins.estimate(FootParams(), worn(walked, gyr=gyr, acc=acc))
    notes = of_code(found.diagnostics["notes"], "leans_otherwise")
    assert len(notes) == (degrees > 0.0)
    for note in notes:
        assert note.values["degrees"] == pytest.approx(degrees, abs=1.0)
        assert note.values["at_s"] == pytest.approx(at, abs=6.0)
