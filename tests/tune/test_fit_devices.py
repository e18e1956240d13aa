"""A fit whose items are spread over devices or processes finds what one device finds."""

import jax
import numpy as np
import optax
import pytest
from made.people import OWN, PEOPLE, READINGS, START, likelihood
from made.process import ran, two

from jgait import tune

MESH = """
import os, sys
import jax, numpy as np, optax
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
if len(sys.argv) > 2:
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    jax.distributed.initialize(f"127.0.0.1:{sys.argv[2]}", 2, int(sys.argv[3]))
from made.people import OWN, PEOPLE, READINGS, START, likelihood
from jgait import tune
mesh = jax.make_mesh((jax.device_count(),), ("items",), axis_types=(jax.sharding.AxisType.Auto,))
"""
FIT = """
if jax.device_count() == 4:
    more = {}
else:
    more = dict(starts=2, validation=np.arange(6) >= 2, minibatch=2, key=jax.random.key(0),
                checkpoint_file=sys.argv[1] + ".fit")
fit = tune.fit(
    likelihood, START, OWN, READINGS, optax.adam(0.1), steps=15, subjects=PEOPLE, mesh=mesh, **more
)
if jax.process_index() == 0:
    np.savez(sys.argv[1], *map(np.asarray, jax.tree.leaves(tuple(fit[:8]))))
print(jax.device_count())
"""


def alone(**more):
    return tune.fit(likelihood, START, OWN, READINGS, optax.adam(0.1), steps=15, subjects=PEOPLE, **more)


def close(file, fit):
    with np.load(file) as found:
        for name, leaf in zip(found.files, jax.tree.leaves(tuple(fit[:8])), strict=True):
            np.testing.assert_allclose(found[name], np.asarray(leaf), rtol=1e-9, atol=1e-12)


def test_four_devices_share_six_items(tmp_path):
    """Six items do not divide by four: the rest is filled up without weight."""
    assert ran(MESH + FIT, tmp_path / "four.npz", devices=4).split() == ["4"]
    close(tmp_path / "four.npz", alone())


@pytest.mark.release
def test_two_processes_share_the_items_and_both_get_the_result(tmp_path):
    two(MESH + FIT, tmp_path / "two.npz", devices=1)
    batches = alone(starts=2, validation=np.arange(6) >= 2, minibatch=2, key=jax.random.key(0))
    close(tmp_path / "two.npz", batches)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"validation": np.arange(6) < 2}, "the number of validation items"),
        ({"minibatch": 2, "key": jax.random.key(0)}, "minibatch"),
    ],
)
def test_parts_of_the_items_must_divide_by_the_devices(change, what):
    class Three:
        size, axis_names = 3, ("items",)

    with pytest.raises(ValueError, match=f"on 3 devices {what} must be a multiple of it; got 2"):
        alone(mesh=Three(), **change)
