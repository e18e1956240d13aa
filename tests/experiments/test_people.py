"""Simulated strides beside recorded ones: sensors that a person predicts, walks to learn from, and shoes."""

import numpy as np
import pytest

from experiments.people import fitted, shoes, transfer
from jgait.simulate.sensors import IDEAL, ON_SHOE

pytestmark = pytest.mark.release


def test_a_person_predicts_own_sensors_in_any_orientation_and_other_people_less():
    one, other = (
        fitted.simulate.Person(gait=fitted.simulate.RECORDED._replace(soft_tissue=1.0, style_1=style))
        for style in (0.0, 1.5)
    )
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    seen = {name: fitted.StrideSignals(*(part @ turn for part in own)) for name, own in
            fitted.virtual(one, ("ankle_right", "foot_right")).items()}  # fmt: skip
    for same, differs in zip(*(fitted.predicted(who, 0.0, seen).values() for who in (one, other)), strict=True):
        assert same.gyr < 1e-9 and same.acc < 1e-9 and same.correlation > 1.0 - 1e-12
        assert differs.gyr > 0.01 and differs.acc > 0.01


def test_simulated_walks_to_learn_from_have_the_path_of_the_sensor_and_contacts():
    (walk,), (known,) = transfer.walkers(1), transfer.waists(1)
    path = np.asarray(walk.reference.feet.right.position)
    assert list(walk.recording.sensors) == ["foot_right"] and len(path) == len(
        walk.recording.sensors["foot_right"].time
    )
    # Round the rectangle and back, where it ends beside the start.
    assert 2.5 < np.ptp(path[:, 0]) < 6.5 and 1.5 < np.ptp(path[:, 1]) < 4.5
    assert np.linalg.norm(path[-1] - path[0]) < 1.0 and np.abs(path[-1, 2] - path[0, 2]) < 1e-6
    assert list(known.recording.sensors) == ["lower_back"]
    ((begin, end),) = known.straight.looked
    inside = known.contacts[(known.contacts > begin) & (known.contacts < end)]
    assert len(inside) == len(known.contacts) - 2 and 0.4 < np.diff(inside).min() <= np.diff(inside).max() < 0.8


def test_a_shoe_on_which_a_sensor_sways_rests_less_and_its_landings_shake_it():
    perfect, worn = (
        shoes.medians(list(walk.recording.sensors.values()) for walk in transfer.walkers(1, errors))
        for errors in (IDEAL, ON_SHOE)
    )
    assert perfect[1] == worn[1] == 1
    assert perfect[0].rest < 0.01 < worn[0].rest < 0.1 and 1.5 < worn[0].shakes / perfect[0].shakes < 20.0
    assert all(0.02 < shoe.heel_up < 0.2 for shoe, _ in (perfect, worn))
