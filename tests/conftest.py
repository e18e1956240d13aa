"""How the tests run JAX: float64, no silent change of rank or type, compiled programs kept between runs."""

import functools
import gc
import importlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

# Read when JAX first compiles, here and in the processes that tests start. Compiling takes most of a run: with LLVM's
# cheap optimisations alone it needs about half the time; without any, filters run ten times longer.
# Without the library for small sums (`jgait.geometry.arrays`), compiling needs a third less again; in one piece, a
# twentieth less.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_optimization_level=1 --xla_llvm_disable_expensive_passes=true "
    "--xla_cpu_experimental_ynn_fusion_type= --xla_cpu_parallel_codegen_split_count=1",
)

import jax
import jaxtyping
import pytest
import typechecker
from xdist.scheduler import LoadScopeScheduling

# Functions check the shapes and types in their annotations at each call or trace.
jaxtyping.install_import_hook(typechecker.MODULES, "typechecker.check")

from experiments.common.sets import datasets  # noqa: E402


def pytest_configure(config: pytest.Config) -> None:
    gc.set_threshold(100_000, 50, 50)  # traces make many objects and hardly any garbage
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_numpy_rank_promotion", "raise")
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    # Workers and later files share even the smallest programs. Beside pytest's own cache `make clean` reaches them.
    compiled = Path(os.environ.get("JAX_COMPILATION_CACHE_DIR") or config.rootpath / ".pytest_cache" / "jax")
    jax.config.update("jax_compilation_cache_dir", str(compiled))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


_COMPILED: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, seconds, **_: _COMPILED.append(event) if event.endswith("backend_compile_duration") else None
)


@pytest.fixture
def compiled() -> list[str]:
    """An entry for each program that was compiled, or read from the cache, since the list was cleared."""
    _COMPILED.clear()
    return _COMPILED


@pytest.fixture
def unchecked() -> Iterator[None]:
    """Annotations are not checked, so that values of a wrong type reach the errors that users see."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


LONG = frozenset({"commands", "estimators", "evaluate", "experiments", "filtering", "simulate", "tune"})
"""Folders of tests that take most of the time."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Folders whose tests take long come first, so that short ones are left to even out the workers."""
    items.sort(key=lambda item: LONG.isdisjoint(Path(item.location[0]).parts))


class _Files(LoadScopeScheduling):
    """The tests of a file go to one worker, and make once what they share; of the contract, those of an estimator."""

    def _split_scope(self, nodeid: str) -> str:
        file, _, test = nodeid.partition("::")
        return test.rpartition("[")[2] if file.endswith("test_contract.py") else file


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadScopeScheduling:
    """Groups by the tests' names: pytest 9.2 drops the marker's group, which pytest-xdist 3.8 adds to them."""
    return _Files(config, log)


def pytest_collection_finish() -> None:
    """What collection has made lasts: garbage is not looked for in it."""
    gc.collect()
    gc.freeze()


MAPPINGS = 30_000
"""Memory mappings that a worker may hold. Linux allows a process 65 530, and every compiled program takes some: kept
for the whole run, they end it with a crash in the compiler."""


def _mappings() -> int:
    maps = Path("/proc/self/maps")
    return maps.read_bytes().count(b"\n") if maps.exists() else 0


@pytest.fixture(scope="module", autouse=True)
def _programs_let_go() -> Iterator[None]:
    """After a file, once many are held, compiled programs are let go; the next file loads what it needs again."""
    yield
    if _mappings() > MAPPINGS:
        jax.clear_caches()
        gc.collect()


@pytest.fixture(scope="session")
def data() -> Callable[..., datasets.Walks]:
    """`data("neura_sparse")`: the walks of a public data set, or those named after it; a skip if they are not there."""

    loaded = functools.cache(datasets.load)

    def load(name: str, *chosen: str) -> datasets.Walks:
        if not datasets.available(name):
            pytest.skip(datasets.unavailable_reason(name))
        if lacking := set(chosen) - set(datasets.names(name)):
            pytest.skip(f"{name} lacks {', '.join(lacking)}")
        return loaded(name, chosen or None)

    return load


@pytest.fixture
def data_dir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of data sets, empty for the test; no data set has been downloaded."""
    monkeypatch.setenv("JGAIT_DATA_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path


@pytest.fixture(scope="session")
def load_experiment() -> Callable[[str], ModuleType]:
    """`load_experiment("tuning.noise")`: the module experiments/tuning/noise.py."""
    return lambda name: importlib.import_module(f"experiments.{name}")
