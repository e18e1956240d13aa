"""Gaits that are not the usual one: people can walk so, and they differ as they say."""

import jax
import numpy as np
import pytest

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
        simulate.check_person(changed)
        assert changed.body == usual.body
        np.testing.assert_allclose(changed.gait.stride_length, other.length * usual.gait.stride_length)
        np.testing.assert_allclose(changed.gait.stride_time, other.time * usual.gait.stride_time)
        assert other.fields.items() <= changed.gait._asdict().items()


def test_steps_of_a_limp_differ():
    person = simulate.Person()._replace(gait=simulate.Gait(steps=6.0, quiet_before=0.5, quiet_after=0.5))
    _, truth = simulate.recording(jax.random.key(0), simulate.walking(person, "limping"), placements=("foot_right",))
    first, second = np.diff(np.asarray(truth.plan.x))[3:5]  # steps, after the first
    np.testing.assert_allclose(abs(first - second) / (first + second), 0.2, rtol=1e-6)


def test_a_gait_that_is_none_is_refused():
    with pytest.raises(ValueError, match="a gait is one of slow, fast, .*; got 'sneaking'"):
        simulate.walking(simulate.Person(), "sneaking")
