"""The project around the library: what is shipped, what is promised, and how the environment is set up."""

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

import jgait

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
HEAVY = ("dask", "distributed", "matplotlib", "pandas", "pooch", "python_calamine", "rich", "typer")


def tracked() -> list[Path]:
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [Path(name) for name in names.split("\0") if name and (ROOT / name).exists()]


def python(code: str) -> str:
    # -P: what is imported is the installed package, wherever the test runs.
    return subprocess.run([sys.executable, "-P", "-c", code], check=True, capture_output=True, text=True).stdout


# --- the package ---


def test_the_version_the_names_and_the_command_are_those_promised():
    assert jgait.__version__ == importlib.metadata.version("jgait")
    assert re.fullmatch(r"\d+\.\d+\.\d+", jgait.__version__)
    assert f"version: {jgait.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert sorted(jgait.__all__) == sorted(set(jgait.__all__))
    assert all(hasattr(jgait, name) for name in jgait.__all__)
    (entry,) = [e for e in importlib.metadata.entry_points(group="console_scripts") if e.name == "jgait"]
    assert entry.value == "jgait.cli:main"
    assert callable(entry.load())


def test_importing_the_library_sets_nothing_and_brings_nothing_heavy():
    code = f"""
import jax, json, os, pathlib, scipy.ndimage, sys, warnings
settings, environment, filters = dict(jax.config.values), dict(os.environ), list(warnings.filters)
import jgait
first = [name for name in {HEAVY} if name in sys.modules]
folder = pathlib.Path(jgait.__file__).parent
for file in folder.rglob("*.py"):
    name = ".".join(["jgait", *file.relative_to(folder).with_suffix("").parts])
    if not name.startswith(("jgait.cli", "jgait.commands.")):
        __import__(name.removesuffix(".__init__"))
then = [name for name in {HEAVY} if name in sys.modules]
changed = [name for name, value in jax.config.values.items() if settings.get(name, value) != value]
print(json.dumps([first, then, changed, dict(os.environ) == environment, list(warnings.filters) == filters]))
"""
    assert json.loads(python(code)) == [[], [], [], True, True]


# --- the checkout ---


def test_top_level():
    needed = {
        "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "Makefile", "README.md", "pyproject.toml",
        "requirements.lock", "requirements-demo.lock",
    }  # fmt: skip
    hidden = {".ci", ".gitignore", ".python-version"}
    top = {path.parts[0] for path in tracked()}
    assert needed | hidden | {"jgait", "tests"} <= top
    assert top <= needed | hidden | {"docs", "findings", "jgait", "experiments", "tests", "notebooks"}


def test_no_file_knows_the_machine_it_was_written_on():
    path = re.compile(r"(?<![\w.:/])/(home|root|work|Users)/")
    found = []
    for name in tracked():
        if name.suffix not in {".png", ".npz", ".xlsx", ".mat"} and name != Path("tests/test_project.py"):
            lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
            found += [f"{name}:{number}: {line}" for number, line in enumerate(lines, 1) if path.search(line)]
    assert found == []


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", ".ci/run"])
def test_every_make_command_that_is_named_exists(name):
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    commands = re.findall(r"(?:^[ $]*|`)make ([a-z]+)\b", (ROOT / name).read_text(), re.MULTILINE)
    assert commands
    assert set(commands) <= targets


def test_the_python_asked_for_is_one_that_is_supported():
    pinned = (ROOT / ".python-version").read_text().strip()
    assert pinned == "3.12"
    assert f"{pinned}.0" in SpecifierSet(PROJECT["requires-python"])


# --- the lock ---


def locked() -> dict[str, list[str]]:
    entries: dict[str, list[str]] = {}
    for line in (ROOT / "requirements.lock").read_text().splitlines():
        if pinned := re.match(r"([a-z0-9-]+)==(\S+)", line):
            entries.setdefault(pinned[1], []).append(pinned[2])
    return entries


def declared(extra: str) -> list[Requirement]:
    """What an extra asks for, the extras of jgait that it names included."""
    result = []
    for requirement in map(Requirement, PROJECT["optional-dependencies"][extra]):
        if requirement.name == "jgait":
            result += [one for name in sorted(requirement.extras) for one in declared(name)]
        else:
            result.append(requirement)
    return result


def test_the_lock_holds_what_is_declared():
    versions = locked()
    for requirement in [*map(Requirement, PROJECT["dependencies"]), *declared("dev")]:
        found = versions.get(canonicalize_name(requirement.name))
        assert found, f"requirements.lock has no {requirement.name}: make lock"
        assert all(version in requirement.specifier for version in found), f"{requirement}: make lock"


def test_every_line_of_the_lock_is_exact_hashed_and_names_no_index():
    text = re.sub(r"\\\n\s*", "", (ROOT / "requirements.lock").read_text())
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    assert len(lines) > 20
    for line in lines:
        assert re.fullmatch(r"[a-z0-9-]+==[^\s;]+ (; .+? )?(--hash=sha256:[0-9a-f]{64} ?)+", line), line[:80]


# --- the environment ---


class Machine:
    """A folder with a checkout's set-up script, and a PATH that holds the pythons it is given and no other."""

    def __init__(self, folder: Path) -> None:
        self.checkout, self.bin = folder / "a checkout", folder / "bin"
        (self.checkout / ".ci").mkdir(parents=True)
        self.bin.mkdir()
        shutil.copy(ROOT / ".ci" / "setup", self.checkout / ".ci")
        for tool in ("cat", "dirname", "mkdir", "rm"):
            (self.bin / tool).symlink_to(shutil.which(tool))

    def has(self, name: str, version: str) -> None:
        """A program that says it is this Python, and can do nothing else."""
        new, series = tuple(map(int, version.split("."))) >= (3, 12), version.rpartition(".")[0]
        lines = ["#!/bin/sh", 'case "$2 $3" in', f"*print*) echo {version} ;;"]
        lines += [f"*\"!= '{series}'\"*) exit 0 ;;", "*!=*) exit 1 ;;", f"*exit*) exit {int(not new)} ;;"]
        lines += ["'venv --without-pip') ;;"]
        (self.bin / name).write_text("\n".join([*lines, "*) exit 1 ;;", "esac", ""]))
        (self.bin / name).chmod(0o755)

    def set_up(self, python: str = "", *of: str) -> subprocess.CompletedProcess[str]:
        script = [shutil.which("sh"), str(self.checkout / ".ci" / "setup"), *of]
        environment = {"PATH": str(self.bin), "PYTHON": python}
        return subprocess.run(script, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture
def machine(tmp_path):
    if os.name != "posix":
        pytest.skip("the set-up is a shell script")
    return Machine(tmp_path)


def refused(done: subprocess.CompletedProcess[str], message: str) -> None:
    assert done.returncode == 1
    assert done.stderr.splitlines()[0] == message


def test_without_a_python_that_is_new_enough_it_is_said_what_was_found_and_what_to_install(machine):
    refused(machine.set_up(), "jgait needs Python >= 3.12; found: no Python at all.")
    (machine.bin / "python3").write_text("#!/bin/sh\nexit 127\n")  # a shim without its Python
    (machine.bin / "python3").chmod(0o755)
    refused(machine.set_up(), "jgait needs Python >= 3.12; found: python3 (does not run).")
    machine.has("python3", "3.9.2")
    machine.has("python", "2.7.18")
    done = machine.set_up()
    refused(done, "jgait needs Python >= 3.12; found: python3 (3.9.2), python (2.7.18).")
    assert all(word in done.stderr for word in ("apt install", "brew install", "pyenv install", "uv python install"))
    assert not (machine.checkout / ".venv").exists()


def test_the_first_python_that_is_new_enough_is_taken_or_the_one_that_was_named(machine):
    machine.has("python3", "3.11.9")
    for version in ("3.12.0", "3.14.0", "4.0.0"):
        machine.has("python3.13", version)
        assert machine.set_up().stdout == f"Making .venv with {machine.bin}/python3.13 ({version})\n"
    machine.has("old", "3.8.2")
    machine.has("mine", "3.13.0")
    assert machine.set_up("mine").stdout == f"Making .venv with {machine.bin}/mine (3.13.0)\n"
    refused(machine.set_up("old"), "jgait needs Python >= 3.12; PYTHON=old is 3.8.2.")
    refused(machine.set_up("none"), "jgait needs Python >= 3.12; PYTHON=none is no program.")


@pytest.mark.parametrize(("version", "fits"), [("3.11.9", False), ("3.12.4", True), ("3.13.0", False)])
def test_a_peer_gets_the_python_of_its_series(machine, version, fits):
    peers = machine.checkout / "experiments" / "common" / "peers"
    peers.mkdir(parents=True)
    (peers / "made_up.txt").write_text("# Python 3.12\nmade_up==1.0\n")
    machine.has("python3", version)
    done = machine.set_up("", "peer", "made_up")
    if fits:
        assert done.stdout == f"Making .venv-made_up with {machine.bin}/python3 ({version})\n"
    else:
        refused(done, f"made_up needs Python 3.12; found: python3 ({version}).")
        assert "make peers PYTHON=" in done.stderr
        assert not (machine.checkout / ".venv-made_up").exists()


def test_a_python_with_neither_ensurepip_nor_pip(machine):
    machine.has("python3", "3.12.1")
    done = machine.set_up()
    refused(done, "python3 can make no environment: it has neither ensurepip nor a pip >= 22.3.")
    assert "apt install python3-venv" in done.stderr
    assert not (machine.checkout / ".venv").exists()


@pytest.mark.parametrize("left", ["unfinished", "elsewhere", "empty"])
def test_an_environment_that_is_half_made_or_was_moved_does_not_count(machine, left):
    environment = machine.checkout / ".venv"
    (environment / "bin").mkdir(parents=True)
    if left != "empty":
        (environment / "bin" / "python").write_text("#!/bin/sh\nexit 0\n")  # new enough, and has a pip
        (environment / "bin" / "python").chmod(0o755)
        (environment / ("unfinished" if left == "unfinished" else "ready")).write_text("/another/checkout\n")
    refused(machine.set_up(), "jgait needs Python >= 3.12; found: no Python at all.")


def test_an_environment_that_is_finished_is_only_brought_up_to_date(machine):
    environment = machine.checkout / ".venv"
    (environment / "bin").mkdir(parents=True)
    (environment / "bin" / "python").write_text('#!/bin/sh\n[ "$3" != install ] || echo "$@"\n')
    (environment / "bin" / "python").chmod(0o755)
    (environment / "ready").write_text(f"{machine.checkout}\n")
    done = machine.set_up()
    assert done.returncode == 0
    assert done.stdout.startswith("Bringing .venv up to date\n")
    assert "-m pip install --quiet --require-hashes -r requirements.lock\n" in done.stdout
    assert (environment / "ready").read_text() == f"{machine.checkout}\n"
    assert not (environment / "unfinished").exists()
