"""A person who sits before the walk: the standing after it calibrates, and sitting is stated as sitting. A sensor that
slips in the walk tilts otherwise in the standing after it. A person who leans in a short standing moves no zero.
"""

import functools

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jgait
from jgait import io, simulate
from jgait.estimators import duty_cycled_gyro, leg_ekf
from jgait.simulate.sensors import MPU6000
from jgait.types import Imu, RecordingError

RATE = 100.0
SITS_S, RISES_S = 5.0, 1.6
BEFORE = round((SITS_S + RISES_S) * RATE)


@pytest.fixture(scope="module")
def walk():
    errors = MPU6000._replace(mounting=0.0, packet_loss=0.0)
    placements = ("thigh_right", "shank_right")
    return simulate.cohort(jax.random.key(2), 1, simulate.straight(12.0), errors, RATE, placements, recorded=False)[0][
        0
    ]


def estimated(estimator, recording):
    method = estimator.estimator()
    return method.estimate(method.params, recording)


@pytest.fixture(scope="module")
def plain(walk):
    """Estimator → the estimate of the walk as it is."""
    return functools.cache(functools.partial(estimated, recording=walk))


def seated(walk, stands_s):
    """The recording with a person who sits first, thigh forward, rises, and stands for a time before the walk."""
    cut = round((3.0 - stands_s) * RATE)
    share = np.linspace(0.0, 1.0, round(RISES_S * RATE))
    angle = np.concatenate([np.ones(round(SITS_S * RATE)), 1.0 - share**3 * (10.0 - 15.0 * share + 6.0 * share**2)])
    rng, sensors = np.random.default_rng(0), {}
    for name, imu in walk.sensors.items():
        tilt = np.radians(-85.0 if name.startswith("thigh") else 8.0) * angle
        acc = Rotation.from_rotvec(np.outer(tilt, [0.0, 1.0, 0.0])).inv().apply(imu.acc[:50].mean(axis=0))
        gyr = imu.gyr[:50].mean(axis=0) + np.outer(np.gradient(tilt, 1.0 / RATE), [0.0, 1.0, 0.0])
        gyr, acc = gyr + 0.002 * rng.standard_normal(gyr.shape), acc + 0.03 * rng.standard_normal(acc.shape)
        gyr, acc = np.concatenate([gyr, imu.gyr[cut:]]), np.concatenate([acc, imu.acc[cut:]])
        sensors[name] = Imu(np.arange(len(gyr)) / RATE, gyr, acc, np.ones(len(gyr), bool))
    return walk._replace(sensors=sensors), cut


@pytest.mark.parametrize(("estimator", "stands_s"), [(leg_ekf, 3.0), (leg_ekf, 0.0), (duty_cycled_gyro, 0.0)])
def test_angles_of_the_walk_do_not_depend_on_sitting_before_it(walk, plain, estimator, stands_s):
    recording, cut = seated(walk, stands_s)
    sat = estimated(estimator, recording)
    # Without standing before the walk that at its end calibrates, where a person stands a little differently.
    within = np.radians(0.5 if stands_s else 2.0)
    for angle in ("hip_angle", "knee_angle"):
        a, b = (np.asarray(getattr(one.legs.right, angle)) for one in (plain(estimator), sat))
        np.testing.assert_allclose(b[BEFORE + 100 :], a[cut + 100 :], rtol=0, atol=within)
    begins = np.degrees(
        [np.asarray(one)[200:450].mean() for one in (sat.legs.right.hip_angle, sat.legs.right.knee_angle)]
    )
    np.testing.assert_allclose(begins, [85.0, 93.0], atol=6.0)
    codes = [note.code for note in sat.diagnostics["notes"]]
    assert "sits" in codes and "no_first_standing" not in codes and "knee_implausible" not in codes


def test_who_never_stands_gets_angles_with_a_wider_deviation(walk, plain):
    """Behind a chair, and cut out of the walk; without accelerometers there is no zero, and the reason is given."""
    recording, cut = seated(walk, 0.0)
    last = len(recording.sensors["thigh_right"].time) - round(2.5 * RATE)
    first = BEFORE + 150
    usual = plain(leg_ekf)
    for begin in (0, first):
        sensors = {name: Imu(*(part[begin:last] for part in imu)) for name, imu in recording.sensors.items()}
        never = leg_ekf.estimate(leg_ekf.LegParams(), recording._replace(sensors=sensors))
        assert "zero_of_walking" in [note.code for note in never.diagnostics["notes"]]
        assert never.diagnostics["standing"] is None
        for angle in ("hip_angle", "knee_angle"):
            a, b, deviation = (
                np.asarray(getattr(part.right, angle)) for part in (usual.legs, never.legs, never.stddev)
            )
            off = b[first + 100 - begin :] - a[cut + first + 100 - BEFORE : cut + last - BEFORE]
            assert np.ptp(off) < np.radians(6.0) and abs(off.mean()) < 2.0 * np.median(deviation)
            assert np.median(deviation) > 1.3 * np.median(np.asarray(getattr(usual.stddev.right, angle)))
    bare = {name: imu._replace(acc=None) for name, imu in sensors.items()}
    with pytest.raises(RecordingError, match=r"leg_ekf needs 0.5 s of quiet standing"):
        leg_ekf.prepared(recording._replace(sensors=bare))


@pytest.mark.parametrize(
    ("placement", "degrees"), [("thigh_right", 0.0), ("thigh_right", 20.0), ("shank_right", -15.0)]
)
def test_a_sensor_that_slips_is_noted(walk, placement, degrees):
    imu = walk.sensors[placement]
    later = np.asarray(imu.time) > 0.5 * imu.time[-1]
    slip = Rotation.from_euler("y", degrees, degrees=True)
    gyr, acc = (np.where(later[:, None], slip.apply(np.asarray(part)), part) for part in (imu.gyr, imu.acc))
    recording = walk._replace(sensors={**walk.sensors, placement: imu._replace(gyr=gyr, acc=acc)})
    codes = ("stands_otherwise", "sensor_slipped")
    notes = [note for note in leg_ekf.prepared(recording).notes if note.code in codes]
    found = [(note.code, note.values["placement"], round(abs(float(note.values["degrees"])))) for note in notes]
    assert found == ([("sensor_slipped", placement, abs(degrees))] if degrees else [])
    for note in notes:
        assert -2.5 < note.values["from_s"] - 0.5 * imu.time[-1] < 1.0


def test_a_person_who_stands_otherwise_at_the_end_has_usable_angles_and_one_whose_sensor_slipped_does_not(walk):
    imu = walk.sensors["thigh_right"]
    time = np.asarray(imu.time)
    ends = jgait.analyse(walk, {"height": 1.75}).estimate.strides.end
    for at, slips in ((0.5 * time[-1], True), (float(np.max(ends)) + 0.5, False)):
        turn = Rotation.from_euler("y", 25.0, degrees=True)
        gyr, acc = (np.where(time[:, None] > at, turn.apply(np.asarray(part)), part) for part in (imu.gyr, imu.acc))
        moved = walk._replace(sensors={**walk.sensors, "thigh_right": imu._replace(gyr=gyr, acc=acc)})
        found = jgait.analyse(moved, {"height": 1.75})
        assert [note.code for note in found.notes if note.code in ("stands_otherwise", "sensor_slipped")] == [
            "sensor_slipped" if slips else "stands_otherwise"
        ]
        table = io.analysis_to_dataframes(found)
        right, later = table["strides"]["side"] == "right", table["strides"]["end_s"] > at
        assert table["strides"]["angles_valid"][~right].all()
        assert table["strides"]["angles_valid"][right & ~later].any()
        assert not table["strides"]["angles_valid"][right & later].any()
        assert table["samples"]["angles_valid_right"].all() != slips


def leaning(walk, begin_s, end_s, degrees):
    """The recording of a person who is tilted forward at first, and comes upright before the walk."""
    sensors = {}
    for name, imu in walk.sensors.items():
        time = np.asarray(imu.time)
        share = np.clip((time - begin_s) / (end_s - begin_s), 0.0, 1.0)
        angle = -np.radians(degrees) * 0.5 * (1.0 + np.cos(np.pi * share))
        acc = Rotation.from_rotvec(np.outer(angle, [0.0, 1.0, 0.0])).inv().apply(imu.acc)
        gyr = imu.gyr + np.outer(np.gradient(angle, time), [0.0, 1.0, 0.0])
        sensors[name] = imu._replace(gyr=gyr, acc=acc)
    return walk._replace(sensors=sensors)


@pytest.mark.parametrize(("begin_s", "end_s", "degrees"), [(2.3, 2.9, 3.0), (2.2, 3.0, -3.0)])
def test_a_short_standing_in_which_the_person_leans_does_not_turn_the_angles(walk, plain, begin_s, end_s, degrees):
    first, last, walks = round(2.2 * RATE), round(9.0 * RATE), round(4.0 * RATE)
    moved = leaning(walk, begin_s, end_s, degrees)
    short = {name: Imu(*(part[first:last] for part in imu)) for name, imu in moved.sensors.items()}
    leant = estimated(leg_ekf, walk._replace(sensors=short))
    for angle in ("hip_angle", "knee_angle"):
        a, b = (np.asarray(getattr(one.legs.right, angle)) for one in (plain(leg_ekf), leant))
        np.testing.assert_allclose(b[walks - first :], a[walks:last], rtol=0, atol=np.radians(2.5))
