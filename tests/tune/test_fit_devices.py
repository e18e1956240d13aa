"""A fit whose items are spread over devices or processes finds what one device finds."""

import socket
import subprocess
import sys

import jax
import numpy as np
import optax
import pytest
from made.people import OWN, PEOPLE, READINGS, START, likelihood
from made.process import environment

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


def test_a_mesh_of_one_device_changes_nothing():
    mesh = jax.make_mesh((1,), ("items",), axis_types=(jax.sharding.AxisType.Auto,))
    np.testing.assert_allclose(alone(mesh=mesh).losses, alone().losses, rtol=1e-12)


def test_four_devices_share_six_items(tmp_path):
    """Six items do not divide by four: the rest is filled up without weight."""
    done = subprocess.run(
        [sys.executable, "-c", MESH + FIT, str(tmp_path / "four.npz")], capture_output=True, text=True, timeout=120,
        check=False, env=environment(4),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["4"]
    close(tmp_path / "four.npz", alone())


def test_two_processes_share_the_items_and_both_get_the_result(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    running = [
        subprocess.Popen(
            [sys.executable, "-c", MESH + FIT, str(tmp_path / "two.npz"), port, str(number)], text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment(1),
        )
        for number in range(2)
    ]  # fmt: skip
    said = [process.communicate(timeout=120)[0] for process in running]
    assert [process.returncode for process in running] == [0, 0], said
    batches = alone(starts=2, validation=np.arange(6) >= 2, minibatch=2, key=jax.random.key(0))
    close(tmp_path / "two.npz", batches)


@pytest.mark.usefixtures("unchecked")
def test_items_to_be_judged_by_must_divide_by_the_devices():
    class Three:
        size, axis_names = 3, ("items",)

    with pytest.raises(ValueError, match="on 3 devices the number of validation items must be a multiple of it; got 2"):
        alone(mesh=Three(), validation=np.arange(6) < 2)


@pytest.mark.usefixtures("unchecked")
def test_minibatches_must_divide_by_the_devices():
    class Three:
        size, axis_names = 3, ("items",)

    with pytest.raises(ValueError, match="on 3 devices minibatch must be a multiple of it; got 2"):
        alone(mesh=Three(), minibatch=2, key=jax.random.key(0))
