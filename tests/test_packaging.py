"""What is shipped: sdist and wheel, and the wheel in an environment that holds nothing but what it asks for.

The environment is made once; where no package index answers, what needs it is skipped and says why.
"""

import importlib.metadata
import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import pandas as pd
import pytest
from made import shank as made_shank

from jgait import io

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.release
RUNTIME = {"jax", "jaxlib", "jaxtyping", "numpy", "optax", "pywavelets"}
EXTRAS = ("ezc3d", "h5py", "jinja2", "matplotlib", "pandas", "pooch", "pyarrow", "python-calamine", "rich", "typer")
COMMANDS = ("jgait.cli", "jgait.commands", "jgait.commands.demo")
"""Modules that only the command needs, with the extra `cli`."""

NO_INDEX = re.compile(r"No matching distribution found|Could not find a version|Max retries|Name or service not known")

USER = '''
"""What a user writes, as strictly as mypy asks for it."""

from pathlib import Path

import jgait
from jgait import evaluate, io, params, simulate
from jgait.estimators import ankle_stride, foot_ins, leg_ekf, waist


def distance(file: Path, thigh: float) -> jgait.Estimate:
    recording: jgait.Recording = io.read_csv(file)
    both = leg_ekf.BySide(thigh, thigh)
    return leg_ekf.estimate(leg_ekf.LegParams(thigh_length=both), recording)


reveal_type(io.read_csv(Path("walk.csv")))
reveal_type(distance(Path("walk.csv"), 0.42))
reveal_type(foot_ins.estimate(foot_ins.FootParams(), io.read_csv(Path("shoes.csv"))))
reveal_type(waist.estimate(waist.WaistParams(), io.read_csv(Path("waist.csv"))))
reveal_type(ankle_stride.AnkleParams(lever_ankle=0.04))
reveal_type(simulate.straight(8.0))
reveal_type(params.positive)
reveal_type(evaluate.cohort(leg_ekf.estimator(), []))
reveal_type(jgait.__version__)
io.read_csv(1.5)
leg_ekf.estimate(leg_ekf.LegParams(), "walk.csv")
'''
REVEALED = (
    "types.Recording", "types.Estimate", "types.Estimate", "types.Estimate", "ankle_stride.params.AnkleParams",
    "routes.Route", "params.Transform", "store.Cohort", '"str"',
)  # fmt: skip


def run(command: list[str], **options) -> subprocess.CompletedProcess[str]:
    """Without what this environment says of Python, of the terminal and of jax."""
    hidden = ("PYTHON", "JAX_", "XLA_", "VIRTUAL_ENV", "COLUMNS")
    own = {name: value for name, value in os.environ.items() if not name.startswith(hidden)}
    environment = own | options.pop("env", {})
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment, **options)


class Built(NamedTuple):
    sdist: Path
    wheel: Path


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Source distribution, and the wheel that is built from it, as `pip install` of the former would."""
    folder = tmp_path_factory.mktemp("dist")
    done = run([sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)])
    assert done.returncode == 0, done.stdout + done.stderr
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    return Built(sdist, wheel)


@pytest.fixture(scope="module")
def installed(built, tmp_path_factory):
    """The Python of a new environment, outside the checkout, into which only the wheel was installed."""
    return environment(tmp_path_factory.mktemp("clean"), str(built.wheel))


@pytest.fixture(scope="module")
def lowest(built, tmp_path_factory):
    """The Python of an environment with the wheel, its commands, and the oldest packages that its bounds admit."""
    folder = tmp_path_factory.mktemp("lowest")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    asked = chain(project["dependencies"], *project["optional-dependencies"].values())
    bounds = {match[1]: match[2] for text in asked if (match := re.match(r"([\w-]+)>=([\d.]+)", text))}
    constraints = folder / "lowest.txt"
    constraints.write_text("\n".join(f"{name}=={bound}.*" for name, bound in bounds.items()))
    return environment(folder, f"{built.wheel}[cli]", "--constraint", str(constraints))


def environment(folder: Path, *wanted: str) -> Path:
    """The Python of a new environment with what pip is asked for."""
    made = run([sys.executable, "-m", "venv", "--without-pip", str(folder / "venv")])
    assert made.returncode == 0, made.stderr
    python = folder / "venv" / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-compile", "--retries", "1"]
    done = run([*pip, "--timeout", "30", *wanted], cwd=folder)
    if done.returncode and NO_INDEX.search(done.stderr):
        pytest.skip(f"no package index answers: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    return python


def said_by(python: Path, code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    cache = {"JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir or str(folder / "compiled")}
    seconds = {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.3"}
    return run([str(python), "-W", "error", "-c", code], cwd=folder, env=cache | seconds)


def loaded(python: Path, code: str, folder: Path):
    done = said_by(python, code, folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


# --- what is in the files ---


def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def tracked_files(folder: str) -> set[str]:
    """Files of the checkout that belong to it: no caches."""
    found = (path for path in (ROOT / folder).rglob("*") if path.is_file())
    return {path.relative_to(ROOT).as_posix() for path in found if "__pycache__" not in path.parts}


def test_the_wheel_holds_every_file_of_the_package_and_no_other(built):
    names = set(contents(built.wheel))
    package = {name for name in names if name.startswith("jgait/")}
    assert package == tracked_files("jgait")
    others = [name for name in package if not name.endswith(".py")]
    assert {"jgait/py.typed", "jgait/datasets/walking5m.json", "jgait/report/templates/page.html"} <= set(others)
    assert all(re.match(r"jgait-[\d.]+\.dist-info/", name) for name in names - package)


def test_the_sdist_builds_the_wheel_of_the_checkout(built, tmp_path):
    done = run([sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", str(tmp_path), str(ROOT)])
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    ours, theirs = contents(wheel), contents(built.wheel)
    assert ours.keys() == theirs.keys()
    assert [name for name in ours if ours[name] != theirs[name]] == []


def test_the_sdist_holds_tests_and_experiments(built):
    with tarfile.open(built.sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for name in ("LICENSE", "README.md", "CHANGELOG.md", "pyproject.toml", "experiments/results.json"):
        assert name in names
    assert {Path(__file__).relative_to(ROOT).as_posix(), "experiments/bennett2013/table2.py"} <= names
    assert not [name for name in names if "__pycache__" in name or name.startswith((".venv", "results/"))]


FREE = re.compile(r"Apache|BSD|MIT|MPL|Mozilla|PSF|Python Software Foundation|ISC|Zlib|CC0|0BSD", re.IGNORECASE)
"""Licences under which jgait and what it needs may be passed on, also in a closed product."""


def test_what_the_command_brings_along_may_be_passed_on():
    lock = (ROOT / "requirements-demo.lock").read_text(encoding="utf-8")
    names = [match[1] for line in lock.splitlines() if (match := re.match(r"([\w.-]+)==", line))]
    stated = {}
    for name in names:
        try:
            about = importlib.metadata.metadata(name)
        except importlib.metadata.PackageNotFoundError:  # of another system
            continue
        classes = [text for text in about.get_all("Classifier") or [] if text.startswith("License ::")]
        stated[name] = about.get("License-Expression") or " ".join([*classes, about.get("License", "")[:200]])
    assert len(stated) > 0.9 * len(names)
    assert {name: text for name, text in stated.items() if not FREE.search(text) or "GPL" in text} == {}


# --- the wheel alone ---


def test_only_what_the_library_needs_is_installed(installed, tmp_path):
    code = """
import importlib.metadata, json, pathlib, sys, jgait
names = sorted(one.metadata["Name"].lower() for one in importlib.metadata.distributions())
inside = pathlib.Path(jgait.__file__).is_relative_to(sys.prefix)
typed = (pathlib.Path(jgait.__file__).parent / "py.typed").exists()
print(json.dumps([names, inside, typed]))
"""
    names, inside, typed = loaded(installed, code, tmp_path)
    assert inside
    assert typed
    assert RUNTIME | {"jgait"} <= set(names)
    assert not set(names) & set(EXTRAS)


def test_every_module_is_imported_without_extras_but_the_command_s(installed, tmp_path):
    code = """
import importlib, json, pkgutil, jgait
names, failed = [], {}
for module in pkgutil.walk_packages(jgait.__path__, "jgait."):
    names.append(module.name)
    try:
        importlib.import_module(module.name)
    except ImportError as error:
        failed[module.name] = str(error)
print(json.dumps([names, failed]))
"""
    names, failed = loaded(installed, code, tmp_path)
    assert len(names) > 100
    assert {"jgait.io.tables", "jgait.plot", "jgait.evaluate.cohort", "jgait.datasets.walking5m"} <= set(names)
    assert [name for name in failed if not name.startswith(COMMANDS)] == []
    assert failed["jgait.cli"].startswith("the jgait command needs its extra: pip install 'jgait[cli]'")


def test_a_walk_is_estimated(installed, tmp_path):
    walk = made_shank.shank()
    imu = walk.recording.sensors["shank_right"]
    np.savez(tmp_path / "walk.npz", gyr=imu.gyr, acc=imu.acc)
    code = f"""
import json, jax, numpy as np
jax.config.update("jax_enable_x64", True)
from jgait import io
from jgait.estimators import ankle_stride
signals = dict(np.load("walk.npz"))
rate = {walk.recording.sampling_rate_hz}
recording = io.recording_from_arrays({{"shank_right": signals}}, sampling_rate_hz=rate, gyr_unit="rad/s")
options = ankle_stride.AnkleOptions(length="3d")
estimate = ankle_stride.estimate(ankle_stride.AnkleParams(lever_ankle=0.18), recording, options)
print(json.dumps(np.asarray(estimate.strides.length).tolist()))
"""
    length = loaded(installed, code, tmp_path)
    np.testing.assert_allclose(length, walk.length, atol=0.01)


@pytest.mark.slow
def test_the_oldest_packages_that_are_admitted_read_and_estimate_a_walk(lowest, tmp_path):
    walk = made_shank.shank()
    io.recording_to_dataframe(walk.recording).to_parquet(tmp_path / "walk.parquet")
    command = [str(lowest.parent / "jgait"), "estimate", "walk.parquet", "--out", "out"]
    done = run(command, cwd=tmp_path, env={"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "compiled")})
    assert done.returncode == 0, done.stdout + done.stderr
    strides = pd.read_csv(tmp_path / "out" / "walk_strides.csv")
    assert len(strides) == len(walk.length)


# --- what is missing, in words ---


def test_the_command_says_which_extra_it_needs(installed, tmp_path):
    done = run([str(installed.parent / "jgait"), "--help"], cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("the jgait command needs its extra: pip install 'jgait[cli]' (No module named ")


@pytest.mark.parametrize(
    "code, package",
    [
        ("from jgait import io; io.read_csv('walk.csv')", "pandas"),
        ("from jgait.plot import style; style.blank(1, 1, 3.0, 3.0)", "matplotlib"),
        ("from jgait import datasets; datasets.fetch('footprints')", "pooch"),
    ],
)
def test_what_an_extra_would_bring_is_named(installed, tmp_path, code, package):
    (tmp_path / "walk.csv").write_text("time,thigh_right_gyr_x\n0.0,1.0\n0.01,1.0\n")
    done = said_by(installed, code, tmp_path)
    assert done.returncode == 1
    assert re.search(rf"(ImportError|ModuleNotFoundError): .*\b{package}\b", done.stderr.splitlines()[-1])


# --- types ---


def test_a_user_s_file_is_checked_strictly(installed, tmp_path):
    pytest.importorskip("mypy")
    (tmp_path / "user.py").write_text(USER)
    cache = ROOT / ".mypy_cache" / "packaging"  # of jax's types, which take most of the time
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--python-executable",
        str(installed),
        "--cache-dir",
        str(cache),
    ]
    done = run([*command, "--config-file", os.devnull, "user.py"], cwd=tmp_path)
    lines = done.stdout.splitlines()
    revealed = [line for line in lines if "Revealed type is" in line]
    assert len(revealed) == len(REVEALED), done.stdout + done.stderr
    for line, name in zip(revealed, REVEALED, strict=True):
        assert name in line
        assert '"Any"' not in line
    errors = [line for line in lines if ": error: " in line]
    assert len(errors) == 2, errors  # the last two lines of the file
    assert all("[arg-type]" in line for line in errors)


# --- imports ---


def test_importing_the_library_loads_no_package_but_jax_and_the_types_of_arrays(installed, tmp_path):
    """The types of the records are those of JAX and jaxtyping; `unicodedata` compares names of people.

    experiments/benchmark/imports.py measures the time.
    """
    code = """
import json, sys
import {first}
before = set(sys.modules)
import {then}
print(json.dumps(sorted(set(sys.modules) - before)))
"""
    brought = loaded(installed, code.format(first="jax, jaxtyping, numpy.typing", then="jgait.types"), tmp_path)
    assert "jgait.types" in brought
    assert [name for name in brought if name.split(".")[0] != "jgait"] in ([], ["unicodedata"])
    assert len(brought) <= 6
    alone = loaded(installed, code.format(first="importlib", then="jgait"), tmp_path)
    assert not {"jax", "numpy"} & set(alone)
