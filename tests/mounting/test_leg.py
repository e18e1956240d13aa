"""Which way is forward for thigh and shank, at every walking speed."""

import jax
import numpy as np
import pytest

from jgait import simulate
from jgait.mounting.leg import USUAL_STRIDE_TIME, leg_mounting, stride_time

RATE = 50.0
TURNED = np.diag([-1.0, -1.0, 1.0])  # worn the other way round


@pytest.fixture(scope="module", params=[0.25, 0.4, 1.3])
def walk(request):
    """Gait, standing samples, and sensors in the axes of their segments."""
    gait = simulate.gait(speed=request.param, stature=1.75)._replace(steps=10.0)
    recording, truth = simulate.recording(
        jax.random.key(0), simulate.Person(gait=gait), simulate.straight(20.0), rate=RATE,
        placements=("thigh_right", "shank_right"),
    )  # fmt: skip
    still = np.asarray(truth.estimate.time) < gait.quiet_before - 0.2
    return gait, still, recording.sensors


def mounted(sensors, still):
    return leg_mounting(sensors, "right", slice(0, int(still.sum())), still, RATE, estimator="leg_ekf")


@pytest.mark.parametrize("turn", [np.eye(3), TURNED], ids=["forwards", "backwards"])
def test_forward_of_thigh_and_shank(walk, turn):
    _, still, sensors = walk
    thigh = sensors["thigh_right"]
    sensors = sensors | {"thigh_right": thigh._replace(gyr=thigh.gyr @ turn.T, acc=thigh.acc @ turn.T)}
    made = mounted(sensors, still)
    assert made.sure and not made.swapped
    assert (turn @ made.rows["thigh"][0])[0] > 0.95
    assert made.rows["shank"][0, 0] > 0.95


def test_the_stride_time_is_that_of_the_shank(walk):
    gait, _, sensors = walk
    np.testing.assert_allclose(stride_time(sensors["shank_right"].gyr[:, 1], RATE), gait.stride_time, rtol=0.03)


def test_without_strides_the_stride_time_is_a_usual_one():
    assert stride_time(np.zeros(10), RATE) == USUAL_STRIDE_TIME
    assert stride_time(np.zeros(400), RATE) == USUAL_STRIDE_TIME


def test_a_thigh_that_moves_by_itself_is_not_sure(walk):
    _, still, sensors = walk
    swing = 0.8 * np.random.default_rng(0).normal(size=(still.size, 1)) * [0.0, 1.0, 0.0]
    moved = sensors["thigh_right"]._replace(gyr=np.where(still[:, None], 0.0, swing))
    assert not mounted(sensors | {"thigh_right": moved}, still).sure
