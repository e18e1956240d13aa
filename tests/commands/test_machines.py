"""Commands on many machines: parts that are joined, and workers of Dask, give the files that one run writes."""

import json
import os
import signal
import threading
import time

import numpy as np
import pandas as pd
import pytest
from made import shank
from made.command import run
from made.dask import two_workers
from made.process import ran

from jgait import io
from jgait.commands import machines

COMMANDS = {
    "estimate": ("estimate", "--estimator", "ankle_stride"),
    "evaluate": ("evaluate", "--estimator", "ankle_stride"),
}
TUNE = ("tune", "--simulated", 3, "--paper", "--free", "distance_scale", "--steps", 5)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """A table of four recordings, and of one that is not there."""
    folder = tmp_path_factory.mktemp("walks")
    rows = [{"file": "none.csv", "subject": "p9"}]
    for number in range(4):
        lengths = np.r_[0.7, np.full(4, 1.1 + 0.05 * number), 0.7]
        walk = shank.shank(6, lengths, lever=(0.0, 0.0, 0.04), placement="ankle_right", seed=number)
        io.write_csv(walk.recording, folder / f"w{number}.csv")
        rows.append({"file": f"w{number}.csv", "subject": f"p{number}", "distance_m": lengths.sum()})
    pd.DataFrame(rows).to_csv(folder / "cohort.csv", index=False)
    return folder / "cohort.csv"


@pytest.fixture(scope="module")
def whole(table, tmp_path_factory):
    """Command → the folder that one run wrote."""
    made = {}

    def of(command):
        if command not in made:
            made[command] = tmp_path_factory.mktemp(command) / "out"
            code, said = run(*COMMANDS[command], table, "--out", made[command])
            assert code == 1 and "1 of 5 recordings could not be used" in said, said
        return made[command]

    return of


def same(one, two):
    """Whether two folders hold equal files, but for intermediate results and the manifests."""
    files = [{path.name: path.read_bytes() for path in folder.glob("[!.]*.*")} for folder in (one, two)]
    differ = [name for name in files[0].keys() | files[1].keys() if files[0].get(name) != files[1].get(name)]
    return sorted(differ) == []


def parts(words, out, of=2):
    for number in range(1, of + 1):
        code, said = run(*words, "--out", out, f"--part={number}/{of}")
        assert code in (0, 1) and f"part {number} of {of}" in said and "jgait join" in said, said


@pytest.mark.parametrize("command", COMMANDS)
def test_parts_that_are_joined_are_the_files_of_one_run(command, table, whole, tmp_path):
    words, out = (*COMMANDS[command], table), tmp_path / "out"
    parts(words, out)
    assert [path.name for path in out.iterdir()] == [machines.PARTS]
    if command == "estimate":  # a part that is given again computes what is left
        places = [machines.JobPart(number, 2).place(out) / "estimated" for number in (1, 2)]
        (lost,) = (path for place in places for path in place.glob("w0"))
        kept = {path: path.stat().st_mtime_ns for place in places for path in place.glob("w[12]/*")}
        lost.rename(tmp_path / "lost")
        parts(words, out)
        assert kept and kept == {path: path.stat().st_mtime_ns for path in kept}
        assert lost.is_dir()
    code, said = run("join", out)
    assert code == 1 and "1 of 5 recordings could not be used" in said, said
    assert same(out, whole(command))
    assert not (out / machines.PARTS).exists()
    assert run("join", out)[0] == 2


@pytest.mark.release
def test_a_tuning_in_parts_and_on_workers_is_that_of_one_process(tmp_path):
    code, said = run(*TUNE, "--out", tmp_path / "one")
    assert code == 0, said
    with two_workers() as client:
        more = ("--out", tmp_path / "dask", "--dask", client.scheduler.address)
        # In a process of its own: functions whose annotations are checked, as here, cannot be sent.
        script = "import sys; from made.command import run; print(*run(*sys.argv[1:]))"
        assert ran(script, *TUNE, *more, JAX_ENABLE_X64="1").startswith("0 ")
    parts(TUNE, tmp_path / "parts")
    code, said = run("join", tmp_path / "parts")
    assert code == 0, said
    held = [pd.read_csv(tmp_path / name / "held_out.csv") for name in ("one", "dask", "parts")]
    for other in held[1:]:
        pd.testing.assert_frame_equal(other, held[0], rtol=1e-9)


@pytest.fixture
def made(tmp_path):
    """Parts of a command that nobody ran: number, of, and changes of the manifest."""

    def put(number, of, command="estimate", **changes):
        folder = machines.JobPart(number, of).place(tmp_path)
        folder.mkdir(parents=True, exist_ok=True)
        content = {"arguments": {machines.COMMAND: [command, "walk.csv"], "walk": "walk.csv"}, "finished": True}
        (folder / f".jgait-{command}.json").write_text(json.dumps(content | changes))

    return put


@pytest.mark.parametrize(
    ("calls", "reason"),
    [
        ([], "has no parts; a command makes one by --part K/N"),
        ([((1, 4), {}), ((3, 4), {})], "of 4 parts in {} these are missing: 2, 4"),
        ([((1, 2), {}), ((2, 2), {"finished": False})], "part 2 of 2 did not end; give its command again"),
        ([((1, 2), {}), ((2, 3), {})], "holds part 1 of 2 and part 2 of 3; remove the folders of one of them"),
        ([((1, 1), {}), ((1, 1), {"command": "tune"})], "holds part 1 of 1 and part 1 of 1 twice"),
        ([((1, 2), {}), ((2, 2), {"arguments": {"command": ["estimate", "walk.csv"], "walk": "other.csv"}})],
         "part 2 of 2 is of other arguments or inputs than part 1 of 2: walk was “walk.csv”, there “other.csv”"),
    ],
)  # fmt: skip
def test_parts_that_are_no_whole_are_refused_by_name(made, tmp_path, calls, reason):
    for numbers, changes in calls:
        made(*numbers, **changes)
    code, said = run("join", tmp_path)
    assert code == 2 and reason.format(tmp_path / machines.PARTS) in said, said


def test_a_scheduler_that_does_not_answer_is_named(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    client = distributed.Client
    monkeypatch.setattr(distributed, "Client", lambda address, timeout: client(address, timeout=0.1))
    code, said = run("evaluate", "--simulated", 1, "--dask", "tcp://127.0.0.1:9", "--out", tmp_path / "out")
    assert code == 2 and "--dask: no Dask scheduler answers at tcp://127.0.0.1:9" in said


@pytest.mark.release
@pytest.mark.slow
def test_two_workers_of_dask_one_of_which_is_killed_write_the_files_of_one_run(table, whole, tmp_path):
    with two_workers() as client:
        for command in COMMANDS:
            out = tmp_path / command

            def kill(out=out):  # when the first recording is computed
                while not [*out.glob("*/*")]:
                    time.sleep(0.01)
                os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)

            killer = threading.Thread(target=kill)
            killer.start()
            code, said = run(*COMMANDS[command], table, "--out", out, "--dask", client.scheduler.address)
            killer.join()
            assert code == 1 and "1 of 5 recordings could not be used" in said, said
            assert same(out, whole(command))
