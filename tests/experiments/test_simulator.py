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
