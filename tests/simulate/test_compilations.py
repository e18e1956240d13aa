"""A walk on another route, of another length, with other sensors, compiles nothing."""

import jax
import numpy as np
import pytest

from jgait import simulate
from jgait.simulate.sensors import MPU6000, measure

KEY = jax.random.key(2)


def walk(number, along, **others):
    people = simulate.population(KEY, number + 1, recorded=False)
    person = simulate.covering(KEY, simulate.person_of(people, number), along)
    return simulate.recording(KEY, person, along, MPU6000, **others)


def test_another_walk_compiles_nothing(compiled):
    walk(0, simulate.straight(5.0))
    compiled.clear()
    walk(1, simulate.straight(20.0))
    walk(2, simulate.rectangle(4.0, 3.0, 2), rate=50.0)
    walk(0, simulate.faster(4.0, 1.0, 1.2), placements=("waist", "ankle_left"))
    assert compiled == []


def test_padding_changes_no_piece_of_a_route():
    along = simulate.route({"length": 2.0, "turn": 1.0}, {"length": 3.0, "slope": 0.1, "speed": 0.7, "riser": 0.1})
    wide, distance = simulate.routes.padded(along), np.linspace(-1.0, 7.0, 33)
    assert len(wide.length) == 16
    at = jax.jit(simulate.routes.at)
    for one, other in zip(at(along, distance), at(wide, distance), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-14)
    value_at = jax.jit(simulate.routes.value_at)
    for field in ("slope", "speed", "riser"):
        values = (value_at(route, getattr(route, field), distance) for route in (along, wide))
        np.testing.assert_allclose(*values, atol=1e-14)


@pytest.mark.parametrize("samples", [40, 57])
def test_noise_does_not_depend_on_padding(samples):
    time = np.arange(64) / 100.0
    still = np.zeros((64, 3))
    errors = MPU6000._replace(packet_loss=0.3)
    read = jax.jit(measure)
    whole, part = (read(KEY, time[:end], still[:end], still[:end], errors) for end in (64, samples))
    for name in ("gyr", "acc", "mask"):
        np.testing.assert_allclose(getattr(whole, name)[:samples], getattr(part, name), atol=1e-12)
