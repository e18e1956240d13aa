"""Libraries in environments of their own: how experiments reach them."""

import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def peers(load_experiment):
    if os.name != "posix":
        pytest.skip("the environments are made by a shell script")
    return load_experiment("common.peers")


@pytest.fixture
def made_up(peers, tmp_path, monkeypatch):
    """A checkout whose peer `fake` is this Python; write its script to the folder that this gives."""
    monkeypatch.setattr(peers, "ROOT", tmp_path)
    environment, scripts = tmp_path / ".venv-fake", tmp_path / "experiments" / "common" / "peers"
    (environment / "bin").mkdir(parents=True)
    scripts.mkdir(parents=True)
    shutil.copy(ROOT / "experiments" / "common" / "peers" / "protocol.py", scripts)
    (environment / "bin" / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    (environment / "bin" / "python").chmod(0o755)
    (environment / "ready").write_text(f"{tmp_path}\n")
    return scripts


def write(folder, body):
    lines = ["from protocol import main", "def answer(numbers, factor=2):", f"    {body}", "main(answer)", ""]
    (folder / "fake_product.py").write_text("\n".join(lines))


def test_every_job_is_answered_with_its_own_arrays(peers, made_up):
    write(made_up, "return {'product': numbers * factor, 'large': numbers > 1}")
    jobs = {"walk 1/right": {"numbers": np.arange(3)}, "left": {"numbers": np.array([[0.5]]), "factor": 10.0}}
    found = peers.run("fake_product", jobs)
    assert sorted(found) == ["left", "walk 1/right"]
    np.testing.assert_array_equal(found["walk 1/right"]["product"], [0, 2, 4])
    np.testing.assert_array_equal(found["walk 1/right"]["large"], [False, False, True])
    np.testing.assert_array_equal(found["left"]["product"], [[5.0]])


def test_an_error_in_a_peer_s_environment_is_reported(peers, made_up):
    write(made_up, "raise ValueError('no numbers of this kind')")
    with pytest.raises(RuntimeError, match="fake_product failed in .venv-fake:(.|\n)*no numbers of this kind"):
        peers.run("fake_product", {"a": {"numbers": np.zeros(1)}})


def test_a_peer_that_is_absent_or_half_made_is_named_with_what_makes_it(peers, made_up):
    assert peers.available("fake")
    assert not peers.available("other")
    (made_up.parents[2] / ".venv-fake" / "ready").unlink()
    assert not peers.available("fake")
    with pytest.raises(peers.PeerUnavailable, match="fake is absent: `make peers` installs it in .venv-fake"):
        peers.run("fake_product", {})


def test_every_peer_states_which_python_it_needs_and_is_pinned():
    files = sorted((ROOT / "experiments" / "common" / "peers").glob("*.txt"))
    assert files
    for file in files:
        first, *rest = file.read_text().splitlines()
        assert first.startswith("# Python 3.")
        pins = [line for line in rest if not line.startswith("#")]
        assert any(line.startswith(f"{file.stem}==") for line in pins)
        assert all(line.count("==") == 1 for line in pins)
