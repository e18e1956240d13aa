"""Gaits that are not the usual one: people can walk so, and they differ as they say."""

import jax
import numpy as np
import pytest

from experiments.common.people import check_person
from jgait import simulate


@pytest.fixture(scope="module", params=[False, True], ids=["rules", "recorded"])
def people(request):
    drawn = simulate.population(jax.random.key(3), 5, recorded=request.param)
    return [simulate.person_of(drawn, i) for i in range(5)]


@pytest.mark.parametrize("gait", simulate.GAITS)
def test_people_can_walk_so(people, gait):
    other = simulate.GAITS[gait]
    for usual in people:
        changed = simulate.walking(usual, gait)
        check_person(changed)
        assert changed.body == usual.body
        np.testing.assert_allclose(changed.gait.stride_length, other.length * usual.gait.stride_length)
        np.testing.assert_allclose(changed.gait.stride_time, other.time * usual.gait.stride_time)
        assert other.fields.items() <= changed.gait._asdict().items()
    with pytest.raises(ValueError, match="a gait is one of slow, fast, .*; got 'sneaking'"):
        simulate.walking(people[0], "sneaking")


def test_runners_fly_and_bend_their_knees_in_stance(people):
    """In flight a body falls freely, and the pelvis is highest; in mid stance it is lowest."""
    for person in people[:2]:
        gait = person.gait._replace(steps=10.0, quiet_before=0.5, quiet_after=0.5, pelvis_shock=0.0)
        runner = simulate.walking(simulate.Person(person.body, gait), "running")
        recording, truth = simulate.recording(jax.random.key(0), runner, rate=200.0, placements=("pelvis",))
        time, strides = np.asarray(truth.estimate.time), truth.strides
        contact, leaves = (np.asarray(v)[np.asarray(strides.valid)] for v in (strides.end, strides.final_contact))
        height = np.asarray(truth.motion.pose.pelvis.origin.z)
        force = np.linalg.norm(recording.sensors["pelvis"].acc, axis=1)
        for landed in range(3, 8):
            left = leaves[landed + 2]  # of the foot that lands: its next stride
            flight, stance = (time > left) & (time < contact[landed + 1]), (time > contact[landed]) & (time < left)
            assert 0.05 < contact[landed + 1] - left < 0.12
            assert force[flight].mean() < 4.5
            assert height[flight].min() > height[stance].mean()
            assert np.ptp(height[stance]) > 0.04
            assert force[stance].max() > 1.5 * 9.81


@pytest.mark.parametrize(("stiff", "side"), [(0.9, "right"), (-0.9, "left")])
def test_a_stiff_leg_bends_less_and_swings_outwards(stiff, side):
    who = simulate.walking(simulate.Person(), "stiff_leg")
    gait = who.gait._replace(steps=8.0, quiet_before=0.5, quiet_after=0.5, stiff=stiff)
    _, truth = simulate.recording(jax.random.key(0), simulate.Person(who.body, gait), placements=("foot_right",))
    steady = np.asarray(truth.estimate.time) > np.asarray(truth.plan.contact)[4]  # not the first step of each foot
    knees = {name: np.max(getattr(truth.estimate.legs, name).knee_angle, where=steady, initial=0.0)
             for name in ("right", "left")}  # fmt: skip
    foot = getattr(truth.motion.pose, f"foot_{side}").origin
    swings = np.abs(np.asarray(foot.y)).max() - 0.5 * gait.step_width
    other = {"right": "left", "left": "right"}[side]
    assert knees[side] < knees[other] - np.radians(20.0)
    assert 0.02 < swings < 0.08
    assert np.ptp(np.asarray(getattr(truth.motion.pose, f"foot_{other}").origin.y)) < 0.5 * swings
