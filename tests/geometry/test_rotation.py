"""Rotations: the axioms, the conventions by worked examples, and smoothness where filters go."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jgait.geometry.rotation import (
    Quaternion,
    between,
    conjugate,
    normalised,
    product,
    rotated,
    rotation,
    rows,
    small_logarithm,
    small_turn,
    turn,
)
from jgait.geometry.vectors import Vector, as_array

RNG = np.random.default_rng(0)
START = RNG.bit_generator.state
N = 40


@pytest.fixture(autouse=True)
def same_numbers_whichever_tests_run():
    RNG.bit_generator.state = START


def vectors(length=None, dtype=np.float64):
    """(N, 3) in all directions; of random lengths, or of one."""
    values = RNG.normal(size=(N, 3))
    values = values if length is None else length * values / np.linalg.norm(values, axis=1, keepdims=True)
    return values.astype(dtype)


def split(values):
    """A `Vector` of an array (..., 3)."""
    return Vector(*jnp.moveaxis(jnp.asarray(values), -1, 0))


def joined(vector):
    return np.stack([np.asarray(part) for part in vector], axis=-1)


def quaternions(dtype=np.float64):
    """N in all directions, both signs."""
    return normalised(Quaternion(*jnp.asarray(RNG.normal(size=(4, N)).astype(dtype))))


def scipys(q):
    return Rotation.from_quat(np.asarray(as_array(q), np.float64), scalar_first=True)


def close(a, b, tolerance=1e-12):
    np.testing.assert_allclose(a, b, rtol=0, atol=tolerance)


def same_turn(a, b, tolerance=1e-12):
    """Equal up to the sign, which means nothing."""
    a, b = joined(a), joined(b)
    close(a * np.sign(np.sum(a * b, axis=-1, keepdims=True)), b, tolerance)


def finite_differences(f, x, step=1e-6):
    x = np.asarray(x, np.float64)
    rise = [(np.asarray(f(x + step * e)) - np.asarray(f(x - step * e))) / (2 * step) for e in np.eye(len(x))]
    return np.stack(rise, axis=-1)


# --- matrices ---


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.0099, 0.0101, 1.0, np.pi - 1e-9, np.pi, 5.0])
def test_rotation_matrix_equals_scipy_at_every_size(angle):
    v = vectors(angle)
    close(rotation(jnp.asarray(v)), Rotation.from_rotvec(v).as_matrix())


def test_a_quarter_turn_to_the_left_worked_by_hand():
    close(turn(jnp.asarray([0.0, 0.0, 2.0]), np.pi / 2) @ jnp.asarray([1.0, 0.0, 0.0]), [0.0, 1.0, 0.0])
    q = Quaternion(np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    close(joined(rotated(q, Vector(1.0, 0.0, 0.0))), [0.0, 1.0, 0.0])


# --- axioms of quaternions ---


def test_products_turn_as_products_of_matrices_the_right_one_first():
    a, b, v = quaternions(), quaternions(), vectors()
    close(scipys(product(a, b)).as_matrix(), scipys(a).as_matrix() @ scipys(b).as_matrix())
    close(joined(rotated(product(a, b), split(v))), joined(rotated(a, rotated(b, split(v)))))
    close(joined(rotated(a, split(v))), scipys(a).apply(v))
    close(joined(rotated(conjugate(a), rotated(a, split(v)))), v)
    close(np.stack([joined(row) for row in rows(a)], axis=-2), scipys(a).as_matrix())


# --- small turns


@pytest.mark.parametrize(
    ("angle", "tolerance", "small"),
    [(0.0, 1e-15, 1e-15), (1e-8, 1e-15, 1e-15), (1e-3, 1e-15, 1e-12), (0.5, 1e-10, 1e-9), (1.0, 1e-8, 5e-6)],
)
def test_small_turns_and_their_logarithms_are_as_exact_as_stated(angle, tolerance, small):
    v = vectors(angle)
    q = Quaternion(*Rotation.from_rotvec(v).as_quat(scalar_first=True).T)
    same_turn(normalised(small_turn(split(v))), q, tolerance)
    close(joined(small_logarithm(q)), v, small)


# --- between ---


def check_between(a, b, tolerance):
    q = between(split(a), split(b))
    across = np.linalg.norm(np.cross(a, b), axis=1)
    angle = np.arctan2(across, np.sum(a * b, axis=1))
    length = np.linalg.norm(b, axis=1, keepdims=True)
    wanted = b / length
    found = joined(rotated(q, split(a / np.linalg.norm(a, axis=1, keepdims=True))))
    close(found, wanted, tolerance)
    close(np.linalg.norm(joined(q), axis=-1), 1.0, tolerance)
    close(2.0 * np.arctan2(np.linalg.norm(joined(q)[:, 1:], axis=1), joined(q)[:, 0]), angle, 4.0 * tolerance)


def test_between_takes_one_direction_to_another_by_the_shortest_way():
    check_between(vectors(), vectors(), 1e-14)


@pytest.mark.parametrize("off", [0.0, 1e-15, 1e-12, 1e-8, 1e-6, 1e-3, 0.1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_between_equal_and_opposite_directions(sign, off):
    a = np.concatenate([vectors(1.0), np.eye(3), -np.eye(3)])
    b = sign * a + off * RNG.normal(size=a.shape)
    check_between(a, 7.0 * b, 1e-14)


def test_between_worked_by_hand():
    """Levelling a sensor whose z axis points down: half a turn, about an axis that lies level."""
    q = between(Vector(0.0, 0.0, -9.81), Vector(0.0, 0.0, 1.0))
    close(joined(rotated(q, Vector(0.0, 0.0, -1.0))), [0.0, 0.0, 1.0])
    close([q.w, q.z], [0.0, 0.0])
    same_turn(between(Vector(1.0, 0.0, 0.0), Vector(0.0, 3.0, 0.0)), Quaternion(np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))


# --- gradients, float32, jit and vmap ---


def as_vector(values):
    return Vector(values[0], values[1], values[2])


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (1e-9, 0.0, 0.0), (0.3, -0.2, 0.5), (2.0, 1.0, -2.0)])
@pytest.mark.parametrize(
    "function",
    [
        lambda v: as_array(normalised(small_turn(as_vector(v / 4.0)))),
        lambda v: jnp.stack(small_logarithm(small_turn(as_vector(v / 4.0)))),
        lambda v: rotation(v).ravel(),
    ],
    ids=["small turns", "logarithm", "rotation"],
)
def test_gradients_equal_finite_differences(function, at):
    found = jax.jit(jax.jacrev(function))(jnp.asarray(at))
    close(found, finite_differences(jax.jit(function), at), 1e-8)


@pytest.mark.parametrize(
    "b", [(1.0, 2.0, 2.0), (1.0, 2.0, 2.1), (2.0, -1.0, 0.0), (-1.0, -2.0, -1.7), (-1.0, 2.0, -2.0)]
)
def test_gradient_of_between_equals_finite_differences(b):
    a = jnp.asarray([1.0, 2.0, 2.0])

    def turned(b):
        return as_array(between(as_vector(a), as_vector(b)))

    close(jax.jit(jax.jacrev(turned))(jnp.asarray(b)), finite_differences(jax.jit(turned), b), 1e-8)
    assert np.isfinite(jax.jit(jax.jacrev(turned))(-a)).all()  # where the shortest way is any, no gradient is lost


def test_float32_stays_and_is_close_to_float64():
    v, q = vectors(), quaternions()
    narrow = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), (split(v), q))

    def everything(v, q):
        return normalised(small_turn(v)), between(v, v._replace(x=-v.x)), rotated(q, v), product(q, q)

    wide = everything(split(v), q)
    for found, expected in zip(jax.tree.leaves(everything(*narrow)), jax.tree.leaves(wide), strict=True):
        assert found.dtype == jnp.float32
        close(found, expected, 2e-5)
