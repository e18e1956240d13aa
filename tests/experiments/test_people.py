"""The measures of simulated strides beside recorded ones: spectra, and the classifier."""

import numpy as np
import pytest

from experiments.people import (
    fitted,
    legs,
    mounts,
    out_of_plane,
    shoes,
    strides,
    tables,
    transfer,
    waves,
)
from experiments.simulator import simulated
from jgait.simulate.sensors import IDEAL, ON_SHOE


def test_the_classifier_is_judged_on_people_whom_it_did_not_see():
    random = np.random.default_rng(1)
    people = np.repeat(np.arange(40), 20)
    labels = np.tile([0.0, 1.0], 400)
    values = random.normal(size=(800, 3))
    assert strides.left_out_area(values, labels, people) == pytest.approx(0.5, abs=0.07)
    values[:, 1] += 2.0 * labels
    assert strides.left_out_area(values, labels, people) > 0.85
    # What is peculiar to each person's own pair says nothing of other people.
    peculiar = random.choice([-1.0, 1.0], 40)[people] * (2.0 * labels - 1.0)
    assert strides.left_out_area(peculiar[:, None], labels, people) < 0.75


@pytest.mark.release
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


@pytest.mark.release
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


@pytest.mark.release
def test_a_shoe_on_which_a_sensor_sways_rests_less_and_its_landings_shake_it():
    perfect, worn = (
        shoes.medians(list(walk.recording.sensors.values()) for walk in transfer.walkers(1, errors))
        for errors in (IDEAL, ON_SHOE)
    )
    assert perfect[1] == worn[1] == 1
    assert perfect[0].rest < 0.01 < worn[0].rest < 0.1 and 1.5 < worn[0].shakes / perfect[0].shakes < 20.0
    assert all(0.02 < shoe.heel_up < 0.2 for shoe, _ in (perfect, worn))


def test_rows_of_the_table_are_the_waves_of_a_stride_and_its_beginning_is_found():
    turn = 2.0 * np.pi * np.arange(waves.POINTS) / waves.POINTS
    rng, count = np.random.default_rng(3), len(waves.HARMONICS)
    table = rng.standard_normal((18, 2 * count))
    angles = waves.HARMONICS[:, None] * turn
    series = table @ np.concatenate([np.cos(angles), np.sin(angles)])
    found = waves.harmonics(series).reshape(3, 6, count)
    np.testing.assert_allclose(out_of_plane.amounts(found), table, atol=1e-12)
    # A stride that is read from a tenth of its turn on begins so much later.
    later = waves.harmonics(np.roll(series, -10, axis=1)).reshape(3, 6, count)
    assert abs(waves.late(later[out_of_plane.SHANK], found[out_of_plane.SHANK]) - 0.2 * np.pi) < 0.01


def test_the_tables_are_written_as_they_were_read(tmp_path, monkeypatch):
    before, text = tables.tables(), tables.FILE.read_text(encoding="utf-8")
    monkeypatch.setattr(tables, "FILE", tmp_path / "movement.json")
    tables.write(before)
    assert tables.FILE.read_text(encoding="utf-8") == text


@pytest.mark.release
def test_the_ankle_is_found_between_sensors_of_shank_and_foot():
    given = simulated.Set("", None, 100.0, thigh=(0.02, 0.8), shank=(-0.01, 0.4))
    person = simulated.person_at(1.1, 1.3)
    one = simulated.walks_of([person], given)[0]
    sensors, _ = simulated.leg_of_simulated(one, given, 0)
    leg = legs.Leg(sensors, [simulated.window(one, given.rate_hz)], 0, None, "right")
    found = dict(mounts.by_joints(leg, given.rate_hz))
    assert found["shank from ankle"].up == pytest.approx(0.6 * person.body.shank_length, abs=0.02)
