"""A walk in bouts: it goes on where it stopped, and stands still between."""

import jax
import numpy as np
import pytest

from jgait import simulate
from jgait.simulate import Gait, Person
from jgait.simulate.routes import total_length
from jgait.simulate.sensors import MPU6000

WAYS = [simulate.corner(3.0, 1.0, 2.0), simulate.straight(4.0), simulate.corner(2.0, -0.5, 2.0)]
BREAKS = (2.0, 3.5)
WHO = Person(gait=Gait(width_variability=0.015, length_variability=0.03, quiet_before=1.0, quiet_after=1.0))


@pytest.fixture(scope="module")
def walked():
    return simulate.with_breaks(jax.random.key(0), WHO, WAYS, BREAKS)


def test_bouts_follow_each_other(walked):
    _, truth = walked
    strides, valid = truth.strides, np.asarray(truth.strides.valid)
    steps = [round(float(total_length(way)) / (0.5 * WHO.gait.stride_length)) for way in WAYS]
    begins, ends = (np.asarray(v)[valid] for v in (strides.start, strides.end))
    assert valid.sum() == sum(steps) + len(steps)  # and the closing steps
    assert np.all(ends > begins)
    last = np.cumsum([count + 1 for count in steps])[:-1]
    pauses = begins[last] - ends[last - 1]
    np.testing.assert_array_less(BREAKS, pauses)
    assert np.all(pauses < np.array(BREAKS) + 2.0)
    sides = np.asarray(strides.side)[valid]
    bouts = np.split(sides, last)
    assert all(np.all(np.diff(bout) != 0) for bout in bouts)
    distance = np.asarray(truth.estimate.distance)
    np.testing.assert_allclose(distance[-1], 0.5 * WHO.gait.stride_length * sum(steps), rtol=0.05)
    heading = np.asarray(truth.estimate.diagnostics["heading"])
    assert heading[-1] == pytest.approx(0.5, abs=0.01)
    assert truth.estimate.valid.all()


def test_nobody_moves_in_a_break(walked):
    recording, truth = walked
    time = np.asarray(recording.sensors["pelvis"].time)
    ends = np.asarray(truth.strides.end)[np.asarray(truth.strides.valid)]
    begins = np.asarray(truth.strides.start)[np.asarray(truth.strides.valid)]
    gaps = np.flatnonzero(begins[1:] - ends[:-1] > 1.0)
    assert len(gaps) == len(BREAKS)
    for gap, seconds in zip(gaps, BREAKS, strict=True):
        middle = begins[gap + 1] - 0.4 - 0.5 * seconds  # the heel rises before the foot leaves
        still = np.abs(time - middle) < 0.45 * seconds
        for imu in recording.sensors.values():
            assert np.abs(np.asarray(imu.gyr)[still]).max() < 1e-9
            np.testing.assert_allclose(np.linalg.norm(imu.acc[still], axis=1), 9.80665, atol=1e-6)


def test_errors_of_sensors_go_on_over_breaks():
    recording, _ = simulate.with_breaks(jax.random.key(0), WHO, WAYS[:2], (2.0,), MPU6000, placements=("foot_left",))
    imu = recording.sensors["foot_left"]
    still = [np.asarray(imu.gyr)[part].mean(axis=0) for part in (slice(0, 80), slice(-80, None))]
    assert np.abs(np.asarray(still)).max() > 1e-4  # biased
    np.testing.assert_allclose(still[0], still[1], atol=5e-3)


@pytest.mark.parametrize(
    ("ways", "breaks", "message"),
    [
        (WAYS[:2], (1.0, 2.0), "bouts need a route each, and a positive break between two; got 2"),
        (WAYS[:2], (0.0,), "a positive break"),
        ([simulate.straight(3.0), simulate.route({"length": 3.0, "slope": 0.1})], (1.0,), "begins on 0.1"),
    ],
)
def test_bouts_that_do_not_follow_each_other_are_refused(ways, breaks, message):
    with pytest.raises(ValueError, match=message):
        simulate.with_breaks(jax.random.key(0), WHO, ways, breaks)
