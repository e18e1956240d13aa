"""Files by address and hash: found, missing, spoilt, unknown, fetched."""

import functools
import hashlib
import http.server
import socket
import sys
import threading
from pathlib import Path

import pytest
import typer

from jgait import datasets
from jgait.commands import datasets as command
from jgait.datasets import Failure, Walks, load_each, registry

GOOD = b"upstream's bytes\n"


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """No data folder, and an empty download cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv(registry.DATA_DIR_VARIABLE, raising=False)
    return tmp_path


@pytest.fixture
def little(empty, monkeypatch):
    """A data set of two small files, one in a folder with a blank in its name."""
    digest = hashlib.sha256(GOOD).hexdigest()
    files = {"a b/one.txt": digest, "two.txt": digest}
    known = registry.DatasetInfo("little", "title", "github.com/who/what", "abc123", "none", "nobody", files)
    monkeypatch.setattr(registry, "_registry", lambda: {"little": known})
    folder = empty / "data" / "little"
    folder.mkdir(parents=True)
    monkeypatch.setenv(registry.DATA_DIR_VARIABLE, str(empty / "data"))
    return folder


def test_sets_have_terms_and_addresses():
    described = {file.stem for file in Path(registry.__file__).parent.glob("*.json")}
    assert {"neura_sparse", "walking5m"} < set(registry.NAMES) == described
    assert {"tripod"} < set(datasets.list_datasets()) - described, "sets of another package are known too"
    for name in datasets.list_datasets():
        known = datasets.info(name)
        assert known.licence and known.citation and known.title
        assert len(known.commit) == 40
        assert all(len(digest) == 64 for digest in known.files.values())
    assert "never redistribute" in datasets.info("walking5m").licence
    address = datasets.info("neura_sparse").address("data/sample/a b.txt")
    assert address == (
        "https://raw.githubusercontent.com/gait-tech/gaittoolbox/"
        "5f22592759da133223049b55e348859a4f55fa9d/data/sample/a%20b.txt"
    )


def test_an_unknown_set_and_an_address_elsewhere():
    with pytest.raises(ValueError, match=r"walking5m is at example.org"):
        datasets.info("walking5m")._replace(repository="example.org/a/b").address("x")
    for function in (datasets.info, datasets.load, datasets.path, datasets.fetch, datasets.missing, datasets.available):
        with pytest.raises(ValueError, match="no data set 'mars'; known are neura_sparse, walking5m"):
            function("mars")


@pytest.mark.parametrize("name", ["neura_sparse", "ipol_gait"])
def test_an_absent_set_states_how_to_get_it(empty, monkeypatch, name):
    assert not datasets.available(name)
    assert set(datasets.missing(name)) == set(datasets.info(name).files)
    with pytest.raises(datasets.DatasetUnavailable, match=f"'{name}' is not there: JGAIT_DATA_DIR is not set.*fetch"):
        datasets.load(name)
    monkeypatch.setenv(registry.DATA_DIR_VARIABLE, str(empty))
    with pytest.raises(datasets.DatasetUnavailable, match=f"JGAIT_DATA_DIR={empty} has no folder {name}"):
        datasets.load(name)


def test_verified_unverified_missing_and_spoilt(little):
    (little / "a b").mkdir()
    (little / "a b" / "one.txt").write_bytes(GOOD)
    (little / "more.txt").write_bytes(b"a file that this version does not know")
    assert datasets.path("little") == little
    assert datasets.file("little", "a b/one.txt") == (little / "a b" / "one.txt", True)
    assert datasets.file("little", "more.txt") == (little / "more.txt", False)
    assert datasets.missing("little") == ("two.txt",)
    with pytest.raises(datasets.DatasetUnavailable, match=r"little lacks two.txt in .*fetch\('little'\) gets it"):
        datasets.file("little", "two.txt")
    (little / "two.txt").write_bytes(b"something else")
    with pytest.raises(datasets.ChecksumError, match="two.txt is not upstream's file: sha256 .* found, .* expected"):
        datasets.file("little", "two.txt")
    assert datasets.file("little", "two.txt", strict=False) == (little / "two.txt", False)
    (little / "two.txt").write_bytes(GOOD)
    assert datasets.file("little", "two.txt")[1], "a file that was replaced is read again"


@pytest.fixture
def server(tmp_path, monkeypatch):
    """Upstream on this machine."""
    upstream = tmp_path / "upstream"
    upstream.mkdir()

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=upstream)) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        address = f"http://127.0.0.1:{running.server_port}/"
        monkeypatch.setattr(registry.DatasetInfo, "address", lambda _, path: address + path.replace(" ", "%20"))
        yield upstream
        running.shutdown()
        thread.join()


def test_what_the_own_folder_lacks_is_fetched_once_beside_it(little, server, empty):
    (little / "two.txt").write_bytes(GOOD)
    (server / "a b").mkdir()
    (server / "a b" / "one.txt").write_bytes(GOOD)
    states = []
    cache = datasets.fetch("little", progress=lambda *state: states.append(state))
    assert states[-1] == ("a b/one.txt", len(GOOD), len(GOOD)) and cache == empty / "cache" / "jgait" / "little"
    assert datasets.path("little") == little and datasets.missing("little") == ()
    assert datasets.file("little", "two.txt")[0] == little / "two.txt"
    assert datasets.file("little", "a b/one.txt") == (cache / "a b" / "one.txt", True)
    assert not (little / "a b").exists()
    assert registry.listing("little", "", "*.txt") == ["a b/one.txt", "two.txt"]
    (server / "a b" / "one.txt").unlink()
    assert datasets.fetch("little") == cache, "what is there is not fetched again"


@pytest.mark.parametrize("content, kind, reason", [
    (b"not what was expected", datasets.ChecksumError, "is not the file that was expected: its sha256 is not"),
    (None, OSError, "could not be downloaded: the server answers 404 File not found"),
])  # fmt: skip
def test_fetch_states_why_a_file_did_not_come(little, server, empty, monkeypatch, content, kind, reason):
    monkeypatch.delenv(registry.DATA_DIR_VARIABLE)
    if content is not None:
        (server / "two.txt").write_bytes(content)
    with pytest.raises(kind, match=f"^http://127.0.0.1:.*/two.txt {reason}.{{,15}}$"):
        datasets.fetch("little", ["two.txt"])
    assert not (empty / "cache" / "jgait" / "little" / "two.txt").exists()
    with pytest.raises(ValueError, match="little has no known file 'three.txt'"):
        datasets.fetch("little", ["three.txt"])


def test_the_command_fetches_into_the_cache_with_the_packages_of_its_extra(little, server, monkeypatch, capsys):
    monkeypatch.delenv(registry.DATA_DIR_VARIABLE)
    monkeypatch.setitem(sys.modules, "tqdm", None)
    (server / "a b").mkdir()
    for path in ("a b/one.txt", "two.txt"):
        (server / path).write_bytes(GOOD)
    command.fetch_set("little")
    assert capsys.readouterr().out.strip() == str(datasets.path("little")) and datasets.missing("little") == ()


def test_without_a_network_the_command_says_so_in_one_sentence(little, server, monkeypatch, capsys):
    monkeypatch.delenv(registry.DATA_DIR_VARIABLE)
    with socket.socket() as free:  # a port at which nobody answers
        free.bind(("127.0.0.1", 0))
        host = f"127.0.0.1:{free.getsockname()[1]}"
    monkeypatch.setattr(registry.DatasetInfo, "address", lambda _, path: f"http://{host}/two.txt")
    with pytest.raises(typer.Exit) as ended:
        command.fetch_set("little")
    assert ended.value.exit_code == 2
    expected = f"jgait: http://{host}/two.txt could not be downloaded: no connection to {host} (ConnectionError); "
    assert capsys.readouterr().err.strip().splitlines()[-1] == expected + "check the network"


def test_one_bad_recording_never_takes_the_set_down_but_a_missing_package_does():
    def load_one(name):
        if name == "bad":
            raise ValueError("the file is cut off")
        if name == "xlsx":
            raise ModuleNotFoundError("No module named 'python_calamine'")
        return name

    walks = load_each(["a", "bad", "c"], load_one)
    assert list(walks) == ["a", "c"]
    assert walks.failures == (Failure("bad", "the file is cut off"),)
    assert Walks().failures == ()
    with pytest.raises(ModuleNotFoundError):
        load_each(["a", "xlsx"], load_one)
