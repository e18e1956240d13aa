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


def test_files_that_differ_or_stay_are_found(tmp_path):
    for name, text in (
        ("a.csv", "1"),
        (".a.0.part.csv", "2"),
        ("run/part-0-1/x.csv", "3"),
        ("run/part-0-0/x.csv", "4"),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert killed.content(tmp_path) == {"a.csv": b"1", ".a.0.part.csv": b"2", "run/x.csv": b"43"}
