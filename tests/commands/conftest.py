"""A walk that several files of tests give to the commands."""

import jax
import pytest

from experiments.common import protocols
from jgait import io


@pytest.fixture(scope="session")
def recording():
    """Simulated, with sensors on the right leg: its programs are half as large."""
    return protocols.bennett(jax.random.key(4), placements=("thigh_right", "shank_right"))[0].recording


@pytest.fixture
def walk(recording, tmp_path):
    """The recording as a user's file."""
    return io.write_csv(recording, tmp_path / "walk.csv")
