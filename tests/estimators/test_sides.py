"""The way along strides: of turns, between chord and arc."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait import analyse, simulate
from jgait.estimators.sides import of_turns
from jgait.simulate.sensors import OPAL


def test_the_way_of_a_turn_lies_between_chord_and_arc():
    radius, turn = 1.0, np.array([0.0, 0.5, -1.2, 3.0])
    chord = 2.0 * radius * np.sin(0.5 * np.abs(turn))
    way, deviation = of_turns(jnp.asarray(chord), jnp.asarray(turn))
    arc = radius * np.abs(turn)
    np.testing.assert_allclose(way, 0.5 * (chord + arc), rtol=1e-12)
    np.testing.assert_allclose(deviation, (arc - chord) / np.sqrt(12.0), rtol=1e-12, atol=1e-15)
    slope = jax.grad(lambda turn: of_turns(jnp.asarray(1.0), turn)[0])
    assert float(slope(0.0)) == 0.0 and float(slope(0.4)) > 0.0


def test_a_circle_is_as_long_as_it_is():
    placements = ("foot_right", "foot_left", "shank_right", "shank_left")
    recording, truth = simulate.recording(
        jax.random.key(1), along=simulate.circle(1.2, 3), errors=OPAL, placements=placements
    )
    true = float(truth.estimate.distance[-1])
    found = {one.source: one for one in analyse(recording).comparisons if one.quantity == "distance"}
    for name in ("feet", "shanks", "combined"):
        assert found[name].value == pytest.approx(true, abs=2.5 * found[name].stddev), name
    assert found["feet"].value == pytest.approx(true, rel=0.05)
