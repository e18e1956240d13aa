"""Functions of arrays give the same for arrays of NumPy and of JAX, each in its own kind."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.geometry.arrays import for_each, interpolated, largest_so_far, on_host, put, xp


def test_a_function_is_that_of_its_arguments():
    host = np.linspace(0.1, 2.0, 5)
    both = xp.sqrt(host), xp.sqrt(jnp.asarray(host))
    assert isinstance(both[0], np.ndarray) and isinstance(both[1], jax.Array)
    np.testing.assert_allclose(*both, rtol=1e-15)
    assert isinstance(xp.stack([host, jnp.asarray(host)]), jax.Array)  # one of them is enough, in a list too
    assert isinstance(jax.jit(lambda x: xp.where(x > 1.0, x, 0.0))(host), jax.Array)
    assert xp.pi == np.pi and xp.int32 is np.int32


def test_of_numbers_it_gives_a_number_that_takes_the_type_of_the_arrays_it_meets():
    factor = xp.maximum(0.5, 2.0)
    assert isinstance(factor, float)
    assert (factor * jnp.ones(2, jnp.float32)).dtype == jnp.float32
    with pytest.raises(AttributeError, match="no_such"):
        xp.no_such(1.0)


def test_interpolation_and_the_largest_so_far_have_the_type_of_the_values():
    at, knots = np.linspace(-1.0, 4.0, 11), np.asarray([0.0, 1.0, 3.0])
    values = np.asarray([[0.0, 1.0], [2.0, 0.0], [4.0, 8.0]], np.float32)
    host = interpolated(at, knots, values)
    traced = interpolated(*(jnp.asarray(v, jnp.float32) for v in (at, knots, values)))
    assert host.dtype == np.float32 and host.shape == (11, 2)
    np.testing.assert_allclose(host, traced, rtol=1e-6)
    for of in (np.asarray, jnp.asarray):
        np.testing.assert_array_equal(largest_so_far(of([1.0, 3.0, 2.0, 5.0])), [1.0, 3.0, 3.0, 5.0])


@pytest.mark.parametrize("how", ["set", "add", "max"])
def test_rows_are_put_and_those_behind_the_last_are_left_out(how):
    values, at, new = np.zeros((3, 2)), np.asarray([0, 2, 3]), np.asarray([[1.0, 2.0], [3.0, -4.0], [5.0, 6.0]])
    host = put(values, at, new, how)
    np.testing.assert_array_equal(host, put(jnp.asarray(values), jnp.asarray(at), jnp.asarray(new), how))
    assert not values.any() and host[0, 0] == 1.0


def test_each_of_some_records():
    records, factors = {"a": np.arange(6.0).reshape(2, 3)}, np.asarray([2.0, 3.0])
    host = for_each(lambda record, factor: {"sum": factor * xp.sum(record["a"])}, records, factors)
    assert isinstance(host["sum"], np.ndarray)
    np.testing.assert_allclose(host["sum"], [6.0, 36.0])
    for given in (records, jax.tree.map(jnp.asarray, records)):  # of both kinds, and of JAX's alone
        traced = for_each(lambda record, factor: {"sum": factor * xp.sum(record["a"])}, given, jnp.asarray(factors))
        np.testing.assert_allclose(host["sum"], traced["sum"])
        assert isinstance(traced["sum"], jax.Array) and isinstance(on_host(traced)["sum"], np.ndarray)
