"""Where the sensors on legs are and which way they face, at every walking speed and however they are worn; the zero of
the angles from standing and walking.
"""

import itertools

import jax
import numpy as np
import pytest
from made.notes import of_code
from scipy.spatial.transform import Rotation

from jgait import simulate
from jgait.events.rest import legs_at_rest
from jgait.mounting.cycle import USUAL_STRIDE_TIME, cycle_of, mean_force, stride_time
from jgait.mounting.leg import Pose, posterior, worn_legs
from jgait.mounting.places import places_of

RATE = 50.0
SLOW = 0.9  # m; of strides that are shorter it may be left in doubt which sensor is where
SIX = tuple(f"{segment}_{side}" for segment in ("thigh", "shank", "foot") for side in ("right", "left"))


@pytest.fixture(scope="module", params=[0.3, 0.5, 1.3])
def walk(request):
    """Gait, sensors in the axes of their segments, and the truth."""
    gait = simulate.gait(speed=request.param, stature=1.75)._replace(steps=12.0)
    recording, truth = simulate.recording(
        jax.random.key(0), simulate.Person(gait=gait), simulate.straight(20.0), rate=RATE, placements=SIX
    )
    return gait, recording.sensors, truth.estimate


def turned(sensors, seed):
    """The sensors, each turned at random, and their turns."""
    turns = {name: Rotation.random(random_state=seed + number) for number, name in enumerate(sensors)}
    moved = {
        name: imu._replace(gyr=turns[name].apply(np.asarray(imu.gyr)), acc=turns[name].apply(np.asarray(imu.acc)))
        for name, imu in sensors.items()
    }
    return moved, turns


@pytest.mark.parametrize("kept", [SIX, SIX[:4], SIX[:4:2]], ids=["with feet", "both legs", "one leg"])
def test_sensors_worn_in_any_way_face_forward(walk, kept):
    sensors, turns = turned({name: walk[1][name] for name in kept}, 1)
    still = legs_at_rest([imu.gyr for imu in sensors.values()], RATE)
    worn = worn_legs(sensors, still, RATE, estimator="leg_ekf")
    assert not worn.places.moved and worn.standing is not None
    assert not worn.places.doubtful and not of_code(worn.notes, "forward_unsure")
    assert not worn.places.unsure_of or walk[0].stride_length < SLOW
    for side, leg in worn.legs.items():
        for segment, mounting in leg.segments.items():
            rows = mounting.axes @ turns[f"{segment}_{side}"].as_matrix()
            assert rows[0, 0] > 0.95 and rows[2, 2] > 0.95


@pytest.mark.parametrize("kept", [SIX, SIX[:4]], ids=["with feet", "both legs"])
def test_exchanged_sensors_are_put_in_their_places(walk, kept):
    sensors = {name: walk[1][name] for name in kept}
    mirrored = {name: name.replace("right", "*").replace("left", "right").replace("*", "left") for name in kept}
    for order in [{a: b, b: a} for a, b in itertools.combinations(kept, 2)] + [mirrored]:
        cycle = cycle_of(turned({name: sensors[order.get(name, name)] for name in kept}, 7)[0])
        places = places_of(cycle)
        assert len(places.notes()) == 1
        if walk[0].stride_length < SLOW and places.unsure_of:
            continue
        assert places.worn == {name: order.get(name, name) for name in kept}
        assert places.moved and not places.doubtful


def test_a_thigh_that_moves_by_itself_is_not_sure(walk):
    sensors = {name: walk[1][name] for name in SIX[:4]}
    swing = 0.8 * np.random.default_rng(0).normal(size=(len(sensors["thigh_right"].time), 1)) * [0.0, 1.0, 0.0]
    places = places_of(cycle_of(sensors | {"thigh_right": sensors["thigh_right"]._replace(gyr=swing)}))
    assert not places.moved
    assert [len(places.unsure(name)) for name in SIX[:4]] == [1, 0, 0, 0]


def test_the_stride_time_is_that_of_the_legs(walk):
    gait, sensors, _ = walk
    rates = [np.asarray(sensors[name].gyr)[:, 1] for name in SIX[:4]]
    np.testing.assert_allclose(stride_time(rates, RATE), gait.stride_time, rtol=0.03)
    awake = np.arange(len(rates[0])) / RATE % (1.5 * gait.stride_time) > 0.75 * gait.stride_time  # its own rhythm
    asleep = [np.where(awake, rate, 0.0) for rate in rates]
    np.testing.assert_allclose(stride_time(asleep, RATE, [awake] * len(rates)), gait.stride_time, rtol=0.03)
    assert stride_time([np.zeros(10)], RATE) == stride_time([np.zeros(400)], RATE) == USUAL_STRIDE_TIME


@pytest.mark.parametrize("name", SIX[:4])
def test_the_mean_inclination_in_walking_is_the_true_one(walk, name):
    _, sensors, truth = walk
    cycle = cycle_of({key: sensors[key] for key in SIX[:4]})
    segment, _, side = name.partition("_")
    leg = getattr(truth.legs, side)
    true = np.asarray(leg.hip_angle) - (np.asarray(leg.knee_angle) if segment == "shank" else 0.0)
    inside = np.median([true[window].mean() for window in cycle.windows])
    assert abs(np.angle(mean_force(sensors[name], np.eye(3), cycle)) - inside) < np.deg2rad(3.0)


STANDING, SD = (0.05, -0.02), (0.09, 0.07)


def test_standing_and_walking_that_agree_narrow_the_pose_and_those_that_contradict_widen_it():
    deviations = []
    for off in (0.0, 10.0, 20.0, 30.0):
        pose = Pose(np.array([*STANDING]) + np.deg2rad([0.0, off]), np.ones(()), np.ones(()))
        (_, knee), (_, _, knees) = posterior(pose, STANDING, SD)
        assert -1e-9 <= knee - STANDING[1] <= np.deg2rad(off) + 1e-9
        deviations.append(float(np.sqrt(knees)))
    assert deviations == sorted(deviations) and deviations[0] < SD[1] < deviations[-1]
