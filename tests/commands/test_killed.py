"""A command that is killed and given again leaves the same files as a command that was left alone."""

import pytest

from experiments.damage import killed

KILLS = 4


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A folder with recordings, and with programs that all runs share."""
    folder = tmp_path_factory.mktemp("killed")
    killed.walks(folder)
    return folder


@pytest.mark.release
@pytest.mark.slow
@pytest.mark.parametrize("command", killed.COMMANDS)
def test_a_killed_command_ends_as_if_it_was_never_killed(home, command):
    assert killed.differences(killed.COMMANDS[command], home, KILLS, seed=len(command)) == []
