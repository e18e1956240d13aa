"""A walk that several files of tests give to the commands, and commands that compute nothing."""

import jax
import pytest

from experiments.common import protocols
from jgait import io
from jgait.commands import jobs
from jgait.estimators.about import About, EstimatedRecording
from jgait.types import Estimate, Legs


@pytest.fixture(scope="session")
def recording():
    """Simulated, with sensors on the right leg: its programs are half as large."""
    return protocols.bennett(jax.random.key(4), placements=("thigh_right", "shank_right"))[0].recording


@pytest.fixture
def walk(recording, tmp_path):
    """The recording as a user's file."""
    return io.write_csv(recording, tmp_path / "walk.csv")


@pytest.fixture
def without_estimates(monkeypatch):
    """`jgait estimate` reads the files and prints their notes; the function that computes can be replaced."""

    def read(recording, known):
        time = next(iter(recording.sensors.values())).time
        estimate = Estimate(time, Legs(None, None), None, None, time > -1.0, {"notes": recording.notes})
        return jobs.of_estimate(EstimatedRecording(recording, estimate, None, {}), About(tables=()))

    def replaced(compute=read):
        job = jobs.EstimateJob(About(tables=()), compute)
        monkeypatch.setattr(jobs, "all_sensors", lambda person: job)

    replaced()
    return replaced
