"""One evaluation of a cohort in a process of its own: `python -m experiments.cohort.run SETTINGS`,
a JSON object; see `Settings`.

Prints one JSON object: seconds from the start of the process, peak memory, and the time of each stage.
"""

import contextlib
import functools
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from experiments.common.process import peak_rss

STARTED = time.perf_counter()


class Settings(NamedTuple):
    """What is evaluated, and how.

    Attributes:
        folder: of the walks.
        tables: file for the tables that come out (pickle), or "".
        out: folder for results, or "" for memory.
        how: "one" process and device, "mesh" of four host devices, "processes", "dask" with two workers.
        options: "default" or "paper".
        precision: "float32" or "float64".
        batch: recordings that run at once.
        pause: seconds that reading each takes longer, for there to be time to kill it.
        rank: of this process, with "processes".
        port: of their coordinator.
    """

    folder: str
    tables: str = ""
    out: str = ""
    how: str = "one"
    options: str = "default"
    precision: str = "float32"
    batch: int = 64
    pause: float = 0.0
    rank: int = 0
    port: int = 0


DEVICES = 4


class Stage(NamedTuple):
    """What calls of a function took: seconds by the clock, seconds of its own thread's computing, and how many."""

    wall: float = 0.0
    own: float = 0.0
    calls: int = 0


class Watch:
    """How long functions take, whichever thread calls them."""

    def __init__(self) -> None:
        self.stages: dict[str, Stage] = {}

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function; its time is added to `stages`."""

        @functools.wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            wall, own = time.perf_counter(), time.thread_time()
            try:
                return function(*args, **kwargs)
            finally:
                before = self.stages.get(name, Stage())
                more = time.perf_counter() - wall, time.thread_time() - own, 1
                self.stages[name] = Stage(*(a + b for a, b in zip(before, more, strict=True)))

        return call

    @contextlib.contextmanager
    def on(self, watched: dict[str, tuple[Any, str]]) -> Iterator[None]:
        """Watch attributes, name → (of what, attribute), for a while."""
        before = [(where, name, getattr(where, name)) for where, name in watched.values()]
        for stage, (where, name) in watched.items():
            setattr(where, name, self.timed(stage, getattr(where, name)))
        try:
            yield
        finally:
            for where, name, function in before:
                setattr(where, name, function)


def read_slowly(folder: str, pause: float, name: str) -> Any:
    """A walk from its file, after a while."""
    from experiments.cohort.walks import read

    time.sleep(pause)
    return read(folder, name)


def evaluated(settings: Settings, watch: Watch) -> Any:
    """The tables."""
    import jax

    jax.config.update("jax_enable_x64", settings.precision == "float64")
    if settings.how == "mesh":
        jax.config.update("jax_num_cpu_devices", DEVICES)
    if settings.how == "processes":
        jax.distributed.initialize(f"127.0.0.1:{settings.port}", 2, settings.rank)
    jax.monitoring.register_event_duration_secs_listener(functools.partial(_compiling, watch))

    from experiments.cohort.walks import leg_lengths
    from jgait import evaluate
    from jgait.estimators import leg_ekf
    from jgait.evaluate import buckets, store

    # the distance by kinematics: what is timed is the filter of the legs
    options = leg_ekf.PAPER if settings.options == "paper" else leg_ekf.DEFAULT._replace(distance="stance")
    estimator = leg_ekf.estimator(options)
    # What is watched is not sent to other processes.
    plain = read_slowly if settings.how == "dask" else watch.timed("read", read_slowly)
    read = functools.partial(plain, settings.folder, settings.pause)
    given: dict[str, Any] = {"body": leg_lengths, "read": read, "out": settings.out or None, "batch": settings.batch}
    names = sorted(path.stem for path in Path(settings.folder).glob("*.npz"))
    watched = {
        "prepared": (buckets, "prepared"), "started": (buckets, "_started"), "waited": (jax, "device_get"),
        "finished": (buckets, "_finished"), "appended": (store.Folder, "append"), "tables": (store.Folder, "tables"),
    }  # fmt: skip
    if settings.how == "dask":
        return _on_dask(evaluate.cohort, estimator, names, given)
    if settings.how == "mesh":
        kind = jax.sharding.AxisType.Auto
        given["mesh"] = jax.make_mesh((DEVICES,), ("recordings",), axis_types=(kind,))
    with watch.on(watched):
        return evaluate.cohort(estimator, names, **given)


def _compiling(watch: Watch, event: str, seconds: float, **_: Any) -> None:
    if event.startswith("/jax/core/compile/"):
        before = watch.stages.get("compiled", Stage())
        watch.stages["compiled"] = Stage(before.wall + seconds, 0.0, before.calls + 1)


def _on_dask(cohort: Callable[..., Any], estimator: Any, names: list[str], given: dict[str, Any]) -> Any:
    import logging

    import distributed

    workers = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.CRITICAL}
    with distributed.LocalCluster(**workers) as cluster, distributed.Client(cluster) as client:
        return cohort(estimator, names, client=client, **given)


def main() -> None:
    """Evaluate, and print what it took."""
    settings, watch = Settings(**json.loads(sys.argv[1])), Watch()
    tables = evaluated(settings, watch)
    seconds = time.perf_counter() - STARTED
    told = {"seconds": seconds, "processor_seconds": time.process_time(), "peak_rss_gb": peak_rss(),
            "stages": {name: stage._asdict() for name, stage in watch.stages.items()}}  # fmt: skip
    if settings.tables:
        import pickle

        Path(settings.tables).write_bytes(pickle.dumps(tuple(tables)))
    print(json.dumps(told))


if __name__ == "__main__":
    main()
