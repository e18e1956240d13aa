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


@pytest.mark.parametrize("samples", [40, 57])
def test_noise_does_not_depend_on_padding(samples):
    time = np.arange(64) / 100.0
    still = np.zeros((64, 3))
    errors = MPU6000._replace(packet_loss=0.3)
    read = jax.jit(measure)
    whole, part = (read(KEY, time[:end], still[:end], still[:end], errors) for end in (64, samples))
    for name in ("gyr", "acc", "mask"):
        np.testing.assert_allclose(getattr(whole, name)[:samples], getattr(part, name), atol=1e-12)
