"""One process of the benchmark of latency; prints its answer as JSON. `python -m experiments.benchmark.latency_process`

walks FOLDER LENGTH…            write simulated walks of 21 s: seven sensors, three and one of them; seven, and feet
                                with a range, also of other lengths [s]
parts CACHE COMMAND…            run a `jgait` command; seconds of its parts, and the number of programs
session ESTIMATOR FILES         compilations of a second recording of another length; ms of a warm `run`
cohort FILES many|one           processor seconds to evaluate 100 recordings, of 100 lengths or of one
"""

import json
import sys
import time
from collections import Counter
from pathlib import Path
from statistics import median
from typing import Any

import jax
import numpy as np

SECONDS = 21.0
"""[s] Length of the recording that is estimated alone."""

FEWER = {"three": ("pelvis", "foot_right", "foot_left"), "one": ("foot_right",)}
"""Name of a file → its sensors."""


def cut(recording: Any, seconds: float) -> Any:
    """The recording up to a time after its first sample."""
    start = min(float(sensor.time[0]) for sensor in recording.sensors.values())

    def first(record: Any) -> Any:
        kept = np.asarray(record.time) < start + seconds
        return type(record)(*(None if values is None else np.asarray(values)[kept] for values in record))

    sensors = {placement: first(sensor) for placement, sensor in recording.sensors.items()}
    between = None if recording.feet_range is None else first(recording.feet_range)
    return recording._replace(sensors=sensors, feet_range=between)


def walks(folder: str, *lengths: str) -> float:
    """Write the walks."""
    from experiments.common import protocols
    from jgait import io, simulate
    from jgait.simulate.sensors import MPU6000

    who, how = jax.random.split(jax.random.key(0))
    route, person = simulate.straight(30.0), simulate.person_of(simulate.population(who, 1, recorded=False), 0)
    fit = simulate.covering(how, person, route)
    seven, _ = simulate.recording(how, fit, route, errors=MPU6000, rate=100.0, placements=simulate.SEVEN)
    for name, worn in FEWER.items():
        fewer = seven._replace(sensors={place: seven.sensors[place] for place in worn})
        io.write_csv(cut(fewer, SECONDS), Path(folder) / f"{name}.csv")
    made = {"seven": seven, "range": next(iter(protocols.potter(who, 1))).recording}
    for kind, recording in made.items():
        io.write_csv(cut(recording, SECONDS), Path(folder) / f"{kind}.csv")
        for length in lengths:
            io.write_csv(cut(recording, float(length)), Path(folder) / f"{kind}_{length}.csv")
    return 0.0


class Watch:
    """Seconds of tracing, of XLA and of the cache, and the number of programs, since it was made."""

    def __init__(self) -> None:
        self.seconds = {"tracing": 0.0, "xla": 0.0, "cache": 0.0}
        self.programs = 0
        jax.monitoring.register_event_duration_secs_listener(self._add)

    def _add(self, event: str, seconds: float, **_: Any) -> None:
        if event.endswith(("jaxpr_trace_duration", "jaxpr_to_mlir_module_duration")):
            self.seconds["tracing"] += seconds
        elif event.endswith("backend_compile_duration"):
            self.programs += 1
            self.seconds["xla"] += seconds
        elif event.endswith("cache_retrieval_time_sec"):
            self.seconds["cache"] += seconds
            self.seconds["xla"] -= seconds


class Clock:
    """Processor seconds of functions, each without those that it calls and that are watched too."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self._within = [0.0]

    def watch(self, part: str, owner: Any, name: str) -> None:
        """Add the seconds of a function of a module or class to those of a part."""
        function = getattr(owner, name)

        def timed(*arguments: Any, **named: Any) -> Any:
            start = time.process_time()
            self._within.append(0.0)
            try:
                return function(*arguments, **named)
            finally:
                lasted = time.process_time() - start
                self.seconds[part] += lasted - self._within.pop()
                self._within[-1] += lasted

        setattr(owner, name, timed)


def parts(cache: str, *command: str) -> dict[str, float]:
    """Run a command in this process. Tracing, XLA and the cache are seconds of the clock on the wall."""
    begun = time.process_time()
    from jgait import cli, io, plot
    from jgait.commands import estimate, jobs, recordings
    from jgait.estimators import programs
    from jgait.estimators.interface import Estimator

    del estimate, plot
    imports = time.process_time() - begun + BEFORE
    watch, clock = Watch(), Clock()
    clock.watch("reading", recordings, "recording_of")
    clock.watch("preparing", Estimator, "estimate")
    clock.watch("running", Estimator, "solve")
    clock.watch("running", programs.Program, "__call__")
    clock.watch("making", programs.Program, "_kept")
    for owner, name in ((jobs, "of_analysis"), (jobs, "of_estimate"), (io, "write_table")):
        clock.watch("tables", owner, name)
    clock.watch("figures", jobs.RecordingResults, "drawn")
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_compilation_cache_dir", cache)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    programs.keep(Path(cache))
    cli.app(list(command), standalone_mode=False)
    return {"imports": imports, **watch.seconds, **clock.seconds, "programs": watch.programs}


def session(name: str, files: str) -> dict[str, float]:
    """Two recordings of different lengths, one after the other, and the first again."""
    from jgait import estimators, io
    from jgait.estimators.interface import pad
    from jgait.estimators.programs import bucket, compiled

    estimator = estimators.get(name)
    first = io.read_csv(f"{files}.csv")
    others = [io.read_csv(path) for path in sorted(Path(files).parent.glob(f"{Path(files).name}_*.csv"))]
    estimator.estimate(estimator.params, first)
    watch = Watch()
    for other in others:
        estimator.estimate(estimator.params, other)
    compilations = watch.programs
    made = estimator.prepare(first)
    inputs = pad(made.inputs, bucket(len(made.inputs.time)))
    times = []
    for _ in range(10):
        start = time.process_time()
        jax.block_until_ready(compiled(estimator.run)(estimator.params, inputs, options=made.options))
        times.append(time.process_time() - start)
    return {"next_length_compilations": float(compilations), "warm_run_ms": 1000.0 * median(times)}


def cohort(files: str, lengths: str) -> float:
    """Processor seconds of `evaluate.cohort`, compiling included."""
    from jgait import evaluate, io
    from jgait.estimators import leg_ekf
    from jgait.types import Walk

    whole = io.read_csv(f"{files}.csv")
    seconds = np.linspace(12.0, 20.9, 100) if lengths == "many" else np.full(100, 16.45)
    made = [cut(whole, one)._replace(name=str(number)) for number, one in enumerate(seconds)]
    begun = time.process_time()
    evaluate.cohort(leg_ekf.estimator(), [Walk(one, None, {}) for one in made], batch=16)
    return time.process_time() - begun


if __name__ == "__main__":
    BEFORE = time.process_time()
    jax.config.update("jax_enable_x64", True)
    kinds = {"walks": walks, "parts": parts, "session": session, "cohort": cohort}
    print(json.dumps(kinds[sys.argv[1]](*sys.argv[2:])))
