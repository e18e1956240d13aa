"""The records: they pass through jax unchanged, and what is not there is named."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.types import (
    PLACEMENTS,
    SIDES,
    Estimate,
    Imu,
    Legs,
    LegTrajectory,
    Recording,
    RecordingError,
    as_float,
    leg_of,
    numbered_people,
    people,
)


def trajectory(offset):
    return LegTrajectory(*(jnp.arange(3.0) + offset + k for k in range(4)))


def estimate():
    return Estimate(
        time=jnp.arange(3.0),
        legs=Legs(right=trajectory(0.0), left=None),
        stddev=None,
        distance=jnp.arange(3.0),
        valid=jnp.ones(3, bool),
        diagnostics={"drift": jnp.asarray(0.1)},
    )


def test_an_estimate_is_a_pytree_whose_absent_parts_are_no_leaves():
    leaves, structure = jax.tree.flatten(estimate())
    assert len(leaves) == 1 + 4 + 1 + 1 + 1
    back = jax.tree.unflatten(structure, leaves)
    assert isinstance(back, Estimate)
    assert isinstance(back.legs.right, LegTrajectory)
    assert back.legs.left is None
    assert back.stddev is None


def test_estimates_pass_through_jit_and_vmap():
    def doubled(one):
        return jax.tree.map(lambda leaf: leaf * 2.0 if leaf.dtype == jnp.float64 else leaf, one)

    many = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), estimate())
    result = jax.jit(jax.vmap(doubled))(many)
    assert isinstance(result, Estimate)
    np.testing.assert_array_equal(result.legs.right.y, 2.0 * np.asarray([[3.0, 4.0, 5.0]] * 2))
    assert result.valid.dtype == bool


def test_leg_of_gives_the_side_asked_for_and_names_what_is_not_there():
    legs = Legs(right=trajectory(0.0), left=trajectory(10.0))
    assert leg_of(legs, "right") is legs.right
    assert leg_of(legs, "left") is legs.left
    with pytest.raises(ValueError, match=r"^the left leg was not measured$"):
        leg_of(estimate().legs, "left")
    for side in ("Right", ""):
        with pytest.raises(ValueError, match=rf"^side must be 'right' or 'left'; got {side!r}$"):
            leg_of(legs, side)


def test_placements_come_in_pairs_where_limbs_do():
    assert len(set(PLACEMENTS)) == len(PLACEMENTS)
    ended = [p.rsplit("_", 1) for p in PLACEMENTS if p.endswith(SIDES)]
    assert {segment for segment, side in ended if side == "right"} == {"wrist", "thigh", "shank", "ankle", "foot"}
    assert {segment for segment, side in ended if side == "left"} == {"wrist", "thigh", "shank", "ankle", "foot"}


def test_a_recording_says_what_it_is_when_nobody_did():
    assert issubclass(RecordingError, ValueError)
    imu = Imu(np.arange(2.0), np.zeros((2, 3)), None, np.ones(2, bool))
    recording = Recording({"waist": imu}, 100.0)
    assert (recording.name, recording.subject, recording.notes) == ("recording", "subject", ())


@pytest.mark.parametrize("values", [[1, 2], (1.0, 2.0), np.asarray([1, 2], np.int16), np.asarray([1, 2], np.float32)])
def test_host_arrays_are_float64(values):
    array = as_float(values)
    assert array.dtype == np.float64
    np.testing.assert_array_equal(array, [1.0, 2.0])


def test_a_person_has_one_name_however_it_is_written():
    assert people(["Anna", "anna ", 1, "1", np.int64(1), "NA", " ANNA"]) == [
        "Anna",
        "Anna",
        "1",
        "1",
        "1",
        "NA",
        "Anna",
    ]
    names, number = numbered_people(np.array(["b", "A", "B ", "a"]))
    assert names == ("b", "A") and list(number) == [0, 1, 0, 1]
    for nobody in (None, float("nan")):
        with pytest.raises(ValueError, match="every row needs a subject; 1 of 2 have none"):
            people(["nan", nobody])
