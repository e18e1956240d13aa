"""Fast walks with accelerometers of a small range: what that takes of a stride is restored, or is in its deviation."""

import jax
import numpy as np
import pytest

from jgait import simulate
from jgait.estimators import ankle_stride, foot_ins
from jgait.estimators.ankle_stride import AnkleParams
from jgait.estimators.foot_ins import FootParams
from jgait.simulate import sensors
from jgait.types import as_float

RANGE = 4.0 * sensors.GRAVITY
ROUTE = simulate.straight(8.0)


@pytest.fixture(scope="module")
def walks():
    """Three people who walk fast: recordings without errors of sensors, and their strides."""
    people = simulate.population(jax.random.key(21), 3, recorded=True)
    made = []
    for row in range(3):
        walker = simulate.covering(
            jax.random.key(row), simulate.walking(simulate.person_of(people, row), "fast"), ROUTE
        )
        made.append(simulate.recording(
            jax.random.key(row), walker, ROUTE, rate=100.0,
            placements=("foot_right", "ankle_right"),
        ))  # fmt: skip
    return made


def within_range(recording):
    read = {
        name: imu._replace(acc=np.clip(as_float(imu.acc), -RANGE, RANGE)) for name, imu in recording.sensors.items()
    }
    return recording._replace(sensors=read)


@pytest.mark.parametrize(
    ("estimator", "p"), [(foot_ins, FootParams()), (ankle_stride, AnkleParams())], ids=["foot_ins", "ankle_stride"]
)
def test_clipped_strides_are_right_within_their_deviations(walks, estimator, p):
    far, distances = [], []
    for recording, _ in walks:
        whole, cut = (estimator.estimate(p, one) for one in (recording, within_range(recording)))
        assert any(note.code == "signal_clipped" for note in cut.diagnostics["notes"])
        long = np.asarray(whole.strides.valid) & np.asarray(cut.strides.valid) & (as_float(whole.strides.length) > 1.0)
        change = (as_float(cut.strides.length) - as_float(whole.strides.length))[long]
        far.append(change / as_float(cut.strides_stddev.length)[long])
        distances.append(float(cut.distance[-1]) / float(whole.distance[-1]) - 1.0)
    assert np.mean(np.abs(np.concatenate(far)) < 2.0) > 0.9
    assert np.max(np.abs(distances)) < 0.06
