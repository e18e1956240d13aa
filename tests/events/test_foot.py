import jax
import numpy as np
import pytest
from made.estimators import only
from made.foot import foot
from scipy.spatial.transform import Rotation

from jgait import datasets, simulate
from jgait.datasets.reading import SHORTEST_STRIDE_M
from jgait.estimators import foot_ins
from jgait.events import foot as events
from jgait.simulate.person import RECORDED
from jgait.simulate.sensors import MPU6000


def found(made):
    imu = next(iter(made.recording.sensors.values()))
    return events.stances(imu.gyr, imu.acc, made.recording.sampling_rate_hz)


@pytest.mark.parametrize(
    "gait", [{}, {"swing": 0.9, "stance": 1.5}, {"swing": 0.35, "stance": 0.2, "roll": 0.02}, {"length": 0.3}]
)
def test_one_stance_before_between_and_after_strides(gait):
    made = foot(strides=6, hz=100.0, **gait)
    stances = found(made)
    assert len(stances.start) == 7
    assert np.all(stances.start <= stances.stillest)
    assert np.all(stances.stillest < stances.end)
    # every swing lies between two stances, but for its slow beginning and end
    for k in range(6):
        assert stances.end[k] <= 100.0 * made.lift_off[k] + 20
        assert stances.start[k + 1] >= 100.0 * made.contact[k] - 20


def test_a_stance_of_fast_gait_whose_rate_a_fixed_threshold_takes_for_swing():
    made = foot(strides=6, swing=0.35, stance=0.3)
    imu = made.recording.sensors["foot_right"]
    # a foot that turns on and on from its first to its last swing
    rate = np.where((imu.time > made.lift_off[0]) & (imu.time < made.contact[-1]), 0.9, 0.0)
    angle = np.cumsum(rate) / 100.0
    turn = Rotation.from_rotvec(angle[:, None] * [0.0, 1.0, 0.0])
    gyr = turn.inv().apply(imu.gyr) + rate[:, None] * [0.0, 1.0, 0.0]
    stances = events.stances(gyr, turn.inv().apply(imu.acc), 100.0)
    assert len(stances.start) == 7
    fixed = events.moving_rate(gyr, 100.0) < 0.8
    missed = [not fixed[a:b].any() for a, b in zip(stances.start, stances.end, strict=True)]
    assert missed == [False] + 5 * [True] + [False]


def test_a_foot_that_is_lifted_slowly_stands_between_and_does_not_while_it_moves():
    made = foot(strides=4, swing=4.0, stance=1.5, length=0.3)
    imu = made.recording.sensors["foot_right"]
    assert events.moving_rate(imu.gyr, 100.0).max() < 1.0
    found = events.stances(imu.gyr, imu.acc, 100.0)
    assert len(found.start) == 5
    assert np.all(np.abs(found.end[:-1] / 100.0 - made.lift_off) < 0.3)
    assert np.all(np.abs(found.start[1:] / 100.0 - made.contact) < 0.3)
    estimate = foot_ins.estimate(foot_ins.FootParams(pivot_height=0.0), made.recording)
    np.testing.assert_allclose(estimate.strides.length, 0.3, atol=0.02)


@pytest.mark.parametrize("gait", [{"swing": 0.5}, {"swing": 1.0, "length": 0.6}, {"swing": 0.6, "roll": 0.1}])
@pytest.mark.parametrize("scale", [0.97, 1.0])
def test_a_foot_that_does_not_turn_in_mid_swing_moves_all_the_same(gait, scale):
    made = foot(strides=6, held=1.0, seed=3, **gait)
    imu = made.recording.sensors["foot_right"]
    valleys = events._valleys(events.moving_rate(imu.gyr, 100.0), events.SWING, events.STANCE)
    assert len(valleys) >= 12
    stances = events.stances(imu.gyr, scale * imu.acc, 100.0)
    assert len(stances.start) == 7
    middle = 0.5 * (made.lift_off + made.contact)
    assert np.abs(stances.stillest[:, None] / 100.0 - middle).min() > 0.15


@pytest.mark.parametrize(
    ("speed", "length", "seed", "placement", "style"),
    [
        (0.7, 1.0, 4, "foot_right", {}), (0.5, 0.8, 0, "foot_left", {"usual": RECORDED}),
        (0.7, 1.0, 0, "foot_right", {"usual": RECORDED}), (0.5, 0.8, 3, "foot_right", {"usual": RECORDED}),
    ],
)  # fmt: skip
def test_the_first_and_last_step_of_a_slow_walk_are_whole(speed, length, seed, placement, style):
    """In a slow swing the foot turns to and fro, and it may come down flat before it is stopped."""
    gait = simulate.gait(speed=speed, stride_length=length, length_variability=0.06, time_variability=0.05, **style)
    key, way = jax.random.key(seed), simulate.straight(5.0)
    person = simulate.covering(key, simulate.Person(gait=gait), way)
    both = ("foot_right", "foot_left")
    recording, truth = simulate.recording(key, person, way, errors=MPU6000, placements=both)
    strides = foot_ins.estimate(foot_ins.FootParams(), only(recording, placement)).strides
    side = both.index(placement)
    true = truth.strides.length[np.asarray(truth.strides.valid) & (truth.strides.side == side)]
    np.testing.assert_allclose(strides.length[strides.valid], true, atol=0.02)


@pytest.mark.parametrize("share", [0.2, 0.35, 0.8])
def test_a_swing_that_an_end_of_the_recording_cuts_is_no_stance(share):
    made = foot(strides=5)
    imu = made.recording.sensors["foot_right"]
    begin = int(100.0 * (made.lift_off[0] + share * (made.contact[0] - made.lift_off[0])))
    for part in (slice(begin, None), slice(None, int(100.0 * (made.lift_off[-1] + share * 0.5)))):
        assert len(events.stances(imu.gyr[part], imu.acc[part], 100.0).start) == 5


def test_a_foot_touches_the_ground_before_it_lies_flat():
    """Where the toes are highest when the stance begins, the pitch shows no contact, and the usual time is taken."""
    pitch = np.zeros(600)
    pitch[200:240], pitch[240:295] = np.linspace(0.0, -0.8, 40), np.linspace(-0.8, 0.3, 55)
    pitch[295:310] = np.linspace(0.3, 0.0, 15)
    gyr = np.stack([np.zeros(600), 100.0 * np.gradient(pitch), np.zeros(600)], axis=1)
    rows = np.array([[0, 200, 100], [330, 600, 400]])
    for begin, first, last in ((330, 295, 312), (290, 272, 272)):
        rows[1, 0] = begin
        _, initial = events.contacts(gyr, events.Stances(*rows.T, np.zeros(2)), 100.0)
        assert first <= initial[0] <= last


def test_a_foot_that_comes_down_without_turning_does_not_stand_yet():
    made = foot(strides=3)
    imu = made.recording.sensors["foot_right"]
    acc = imu.acc.copy()
    # after the last contact the foot sinks for a third of a second without turning
    a = int(100 * made.contact[-1]) + 5
    wave = np.sin(2 * np.pi * np.arange(34) / 34)
    acc[a : a + 34, 2] += 20.0 * wave
    plain = events.stances(imu.gyr, imu.acc, 100.0)
    sunk = events.stances(imu.gyr, acc, 100.0)
    assert plain.start[-1] < a + 10
    assert sunk.start[-1] > a + 15


def test_no_stance_of_fast_gait_is_lost_under_vicon(data):
    """Of people on their feet. On 2018-02-09 they creep, kneel and crawl, at less than 0.3 m/s.

    There the shoe is dragged along or turns on its tip, and most of what is slower than 0.5 m/s under Vicon is no
    footprint.
    """
    for walk in data("pyshoe_vicon"):
        imu, prints, name = walk.recording.sensors["foot_right"], walk.info["footprints"], walk.recording.name
        if walk.info["speed"] < 0.3:
            assert name.startswith("2018-02-09"), name
            continue
        stances = events.stances(imu.gyr, imu.acc, walk.recording.sampling_rate_hz)
        inside = events.inside(stances, len(imu.gyr))
        # Vicon's noise parts one stance of 2017-11-22-11-38-45 into two prints, 1 cm apart: the second counts
        apart = np.linalg.norm(np.diff(prints["position"][:, :2], axis=0), axis=1) > SHORTEST_STRIDE_M
        for sample in prints["samples"][np.append(apart, True)]:
            near = np.abs(stances.stillest - sample).min() < 60 or inside[sample]
            assert near, f"{name}: no stance at {sample}"


def test_contacts_near_those_marked_by_hand(data):
    data("gaitmap_example")
    walk = datasets.load("gaitmap_example", only=["imu_sample"])[0]
    for side in ("right", "left"):
        imu, known = walk.recording.sensors[f"foot_{side}"], walk.info["events"][side]
        stances = events.stances(imu.gyr, imu.acc, 204.8)
        final, initial = events.contacts(imu.gyr, stances, 204.8)
        late = {"tc": final, "ic": initial}
        for name, samples in late.items():
            off = np.array([samples[np.abs(samples - at).argmin()] - at for at in known[name]]) / 204.8
            assert abs(np.median(off)) < 0.035
            assert np.percentile(np.abs(off - np.median(off)), 90) < 0.02
