"""The experiment on the simulator measures what it says: its checks find a fault that is put there."""

import numpy as np
import pytest

from experiments.simulator import against_real as experiment
from experiments.simulator import checks

pytestmark = pytest.mark.release


@pytest.fixture(scope="module")
def long():
    return checks.long_walk(12.0)


def test_the_walk_integrates_stands_and_closes(long):
    person, recording, truth = long
    rows = {row.metric: row.value for row in checks.strapdown_rows(recording, truth, person)}
    assert rows["strapdown_position_error_mm_12s"] < 1.0
    assert rows["strapdown_position_error_mm_12s"] < rows["strapdown_position_error_mm_12s_100hz"]
    assert rows["strapdown_order_of_convergence"] > 3.0
    assert checks.stance_motion(truth, person) < 1e-12
    assert checks.length_error(truth, person.body) < 1e-12
    assert checks.standing_error(recording, truth, person) < 1e-9


def test_the_checks_find_a_fault(long):
    person, recording, truth = long
    heavy = person.body._replace(thigh_length=person.body.thigh_length + 0.01)
    assert checks.length_error(truth, heavy) == pytest.approx(0.01, abs=1e-12)
    segments = truth.motion.pose
    foot = segments.foot_left
    sliding = foot._replace(origin=foot.origin._replace(x=foot.origin.x + 0.01 * truth.estimate.time))
    motion = truth.motion._replace(pose=segments._replace(foot_left=sliding))
    # The sole is flat for a fifth of a stride and more.
    assert checks.stance_motion(truth._replace(motion=motion), person) > 1e-3
    biased = {name: imu._replace(acc=imu.acc + 0.5) for name, imu in recording.sensors.items()}
    wrong = recording._replace(sensors=biased)
    assert checks.standing_error(wrong, truth, person) == pytest.approx(0.5, abs=1e-9)
    assert checks.strapdown_rows(wrong, truth, person)[0].value > 1e3


def leg(rate_hz, strides):
    """A shank that swings once every 1.2 s, with the figures' own shape of a stride."""
    time = np.arange(round(strides * 1.2 * rate_hz)) / rate_hz
    phase = time % 1.2

    def bump(at, width):
        return np.exp(-0.5 * (((phase - at + 0.6) % 1.2 - 0.6) / width) ** 2)

    rate = 6.0 * bump(0.6, 0.09) - 3.0 * bump(0.83, 0.04) - 3.5 * bump(0.36, 0.05)
    gyr = np.stack([np.zeros_like(rate), rate, np.zeros_like(rate)], axis=1)
    acc = np.tile([0.0, 0.0, 9.81], (len(time), 1))
    return {"shank": (gyr, acc)}, time


def test_curves_are_cut_from_swing_to_swing():
    simulated = experiment.simulated
    sensors, time = leg(100.0, 8)
    truth = simulated.Truth(hip=np.zeros_like(time), knee=np.radians(60.0) * np.ones_like(time), height=np.sin(time))
    cut = simulated.curves(sensors, 100.0, [(0, len(time))], truth)
    assert set(cut) == {"shank", "shank_acc", "hip", "knee", "height"}
    assert cut["shank"].shape == (7, 101)
    np.testing.assert_allclose(cut["shank"][:, [0, -1]], 6.0, atol=0.3)
    np.testing.assert_allclose(cut["knee"], 60.0)
    np.testing.assert_allclose(cut["height"].mean(axis=1), 0.0, atol=1e-9)
    drawn = simulated.overlay(simulated.SETS[0], cut, cut)
    assert [axis.get_title() for axis in drawn.axes if axis.get_visible()] == [simulated.CURVES[name] for name in cut]


def test_what_is_given_or_has_no_spread_is_not_counted():
    one = experiment.Spread(1.0, 0.9, 1.1, 5, "people")
    real = {"speed": one, "shank_swing": one, "foot_strike_p99": one, "knee_range": one._replace(n=1), "stance": one}
    rows = experiment.compared(experiment.SETS[2], real, dict.fromkeys(real, 1.05) | {"stance": 1.2})
    assert {row.metric: row.value for row in rows} == {
        "inside_tripod_pws_shank_swing": 1.0,
        "inside_tripod_pws_stance": 0.0,
    }


def test_a_parameter_that_helps_is_found():
    one = experiment.Spread(1.0, 0.9, 1.1, 5, "people")
    mine = [(v, 2.0 - v, 3) for v in np.linspace(0.0, 1.2, 7)]
    _, name, now, best, count = experiment._try("heel_up", mine, one, 0.2, 1.8, 1.1)
    assert (name, now, count) == ("heel_up", 0.2, 3)
    assert best == pytest.approx(0.9, abs=0.01)
    assert experiment._try("toe_out", [(v, 1.8, 3) for v in (0.0, 1.0)], one, 0.2, 1.8, 1.1) is None


@pytest.fixture(scope="module")
def walked():
    given = experiment.SETS[0]
    person = experiment.simulated.person_at(1.1, 1.3)
    return given, person, experiment.simulated.walks_of([person], given)[0]


def test_figures_of_a_simulated_walk_are_those_of_its_gait(walked):
    given, person, one = walked
    simulated = experiment.simulated
    found = simulated.medians(simulated.simulated_figures(one, given._replace(resting=False)))
    assert found["stride_time"] == pytest.approx(1.1, rel=0.03)
    assert found["stride_length"] == pytest.approx(1.3, rel=0.03)
    assert found["stance"] == pytest.approx(person.gait.stance_fraction, abs=0.015)
    assert found["stride_width"] == pytest.approx(person.gait.step_width, abs=1e-9)
    curves = simulated.simulated_curves(one, given)
    assert set(curves) == set(simulated.CURVES)
    assert np.ptp(curves["knee"].mean(axis=0)) == pytest.approx(np.degrees(found["knee_range"]), rel=0.1)
