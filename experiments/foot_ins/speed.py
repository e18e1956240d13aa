"""Time of the foot estimator, and its error in float32."""

import time
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import jax
import numpy as np

from experiments.common.recordings import attempt
from experiments.common.row import Row, show
from experiments.foot_ins import gaitmap
from experiments.foot_ins.run import QUICK, bucket, estimated, run_one, sets
from jgait import filtering, simulate
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import DEFAULT, FootOptions, FootParams
from jgait.estimators.interface import pad
from jgait.simulate import sensors
from jgait.types import Imu, Recording

RATE = 200.0
HOUR = 720_000
MINUTE = 6_144
"""[samples] A minute at 100 Hz, for many subjects."""

WALK_M = 100.0
QUICK_WALK = (12.0, 128.0)
"""[m], [Hz] As the simulated people of the quick form, so that they share a program."""

FEET = ("foot_right", "foot_left")


@partial(filtering.compiled, static_argnames=("options",))
def run_many(p: FootParams, inputs: Any, options: FootOptions) -> Any:
    """Strides and distance of stacked recordings."""
    found = jax.vmap(lambda one: foot_ins.run(p, one, options))(inputs)
    return found.strides, found.strides_stddev, found.distance, found.diagnostics


def single(values: Any) -> Any:
    """The same arrays on the host, real numbers in single precision."""
    return jax.tree.map(lambda v: np.asarray(v, np.float32) if np.asarray(v).dtype == np.float64 else v, values)


def timed(call: Callable[[], Any], repeats: int) -> tuple[float, float]:
    """Seconds of the first call, compilation included, and of the fastest of the others."""
    seconds = []
    for _ in range(repeats + 1):
        before = time.perf_counter()
        jax.block_until_ready(call())
        seconds.append(time.perf_counter() - before)
    return seconds[0], min(seconds[1:])


@cache
def walked(length: float, rate: float = RATE) -> Recording:
    """A simulated walk straight ahead, Opal sensors on both feet."""
    key = jax.random.key(0)
    along = simulate.straight(length)
    person = simulate.covering(key, simulate.person_of(simulate.population(key, 1, recorded=False), 0), along)
    return simulate.recording(key, person, along, sensors.OPAL, rate, placements=FEET)[0]


def one_foot(recording: Recording) -> Recording:
    """The right foot alone."""
    return recording._replace(sensors={FEET[0]: recording.sensors[FEET[0]]})


def repeated(recording: Recording, samples: int) -> Recording:
    """The recording again and again, up to a number of samples; it stands at both ends."""

    def longer(values: Any) -> np.ndarray:
        values = np.asarray(values)
        return np.tile(values, (-(-samples // len(values)), *(1,) * (values.ndim - 1)))[:samples]

    placed = {
        name: Imu(np.arange(samples) / recording.sampling_rate_hz, longer(imu.gyr), longer(imu.acc), longer(imu.mask))
        for name, imu in recording.sensors.items()
    }
    return recording._replace(sensors=placed)


def rows(quick: bool) -> list[Row]:
    """What float32 costs, one foot for an hour, and many subjects at once."""
    walk = one_foot(walked(*QUICK_WALK) if quick else walked(60.0))
    return [
        *precision(quick),
        *recorded_precision(quick),
        *hour(walk, QUICK if quick else HOUR, quick),
        *subjects(quick),
    ]


def hour(walk: Recording, samples: int, quick: bool) -> list[Row]:
    """One foot for an hour, from its signals to its strides; and gaitmap's filter in the same run."""
    recording = repeated(walk, samples)
    rate = walk.sampling_rate_hz
    split = f"simulated walk of {len(walk.sensors[FEET[0]].time) / rate:.0f} s again and again, {samples} samples"
    first, best = timed(lambda: foot_ins.estimate(FootParams(), recording), 1 if quick else 3)
    _, prepared = timed(lambda: foot_ins.prepared(recording).inputs.time, 2)
    lines = [["ours", best, prepared, first - best]]
    rows = [
        Row("one_foot_hour_seconds", best, "s", n=samples, split=split),
        Row("one_foot_hour_prepare_seconds", prepared, "s", n=samples, split=split),
    ]
    (imu,) = recording.sensors.values()
    theirs = None if quick else gaitmap.seconds(np.asarray(imu.gyr), np.asarray(imu.acc), rate)
    if theirs is not None:
        lines.append(["gaitmap RtsKalman", theirs, "–", "–"])
        rows += [
            Row("gaitmap_hour_seconds", theirs, "s", n=samples, split=split),
            Row("one_foot_hour_ratio", rows[0].value / theirs, "ratio", n=samples, split=f"{split}; ours/theirs"),
        ]
    columns = ["", "all s", "of it preparation s", "compilation s"]
    show(f"one foot, {samples} samples at {rate:g} Hz ({samples / rate / 60:.0f} min)", columns, lines)
    return rows


def subjects(quick: bool) -> list[Row]:
    """Both feet of many subjects in one call: the same steps, every sensor's noise its own."""
    people = 2 if quick else 50
    # the quick form leaves the smoother out, which takes most of the time to compile;
    # many short recordings at once are as much work as a long one
    samples = 1024 if quick else MINUTE
    options = DEFAULT._replace(smooth=False) if quick else DEFAULT
    walk = walked(*QUICK_WALK) if quick else walked(50.0, 100.0)
    rate_hz = walk.sampling_rate_hz
    prepared = []
    for k in range(people):
        noise = np.random.default_rng(k)

        def own(imu: Imu, noise: np.random.Generator = noise) -> Imu:
            gyr, acc = (noise.normal(v, spread) for v, spread in ((imu.gyr, 0.01), (imu.acc, 0.1)))
            return imu._replace(gyr=gyr, acc=acc)

        one = repeated(walk, samples)
        one = one._replace(sensors={name: own(imu) for name, imu in one.sensors.items()})
        prepared.append(foot_ins.prepared(one).inputs)
    inputs = jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *prepared)
    found = attempt(
        f"{people} subjects at once", lambda: timed(partial(run_many, FootParams(), jax.device_put(inputs), options), 1)
    )
    if found is None:
        return []
    first, best = found
    rate = 2.0 * people * samples / best / 1e6
    title = f"both feet of {people} subjects, {samples} samples at {rate_hz:g} Hz, one call"
    show(title, ["", "s", "million samples/s"], [["ours", best, rate], ["compilation", first - best, "–"]])
    split = f"{samples} samples at {rate_hz:g} Hz, both feet, one vmapped call, preparation apart"
    return [
        Row("subjects_seconds", best, "s", n=people, split=split),
        Row("subjects_million_samples_per_second", rate, "1e6/s", n=people, split=split),
    ]


def precision(quick: bool) -> list[Row]:
    """float32 against float64 along a walk of 100 m."""
    walk = one_foot(walked(*QUICK_WALK) if quick else walked(WALK_M))
    inputs = foot_ins.prepared(walk).inputs
    samples = inputs.time.size
    padded = pad(inputs, bucket(samples))
    exact, rough = (run_one(FootParams(), given, DEFAULT) for given in (padded, single(padded)))
    if rough.feet.right.position.dtype != np.float32:
        raise TypeError(f"float32 inputs gave {rough.feet.right.position.dtype}")
    ours, theirs = (np.asarray(one.feet.right.position, np.float64)[:samples] for one in (exact, rough))
    way = float(np.asarray(exact.distance)[samples - 1])
    rows = np.asarray(exact.strides.valid)
    lengths = [np.asarray(one.strides.length, np.float64)[rows] for one in (exact, rough)]
    worst = 1e3 * float(np.max(np.linalg.norm(ours - theirs, axis=1)))
    stride = 1e3 * float(np.max(np.abs(lengths[0] - lengths[1])))
    show(f"float32 against float64 over {way:.0f} m", ["", "largest difference mm"],
         [["position", worst], ["stride length", stride]])  # fmt: skip
    split = f"simulated walk of {way:.0f} m, {walk.sampling_rate_hz:g} Hz"
    return [
        Row("float32_position_mm", worst, "mm", split=split),
        Row("float32_stride_mm", stride, "mm", n=int(rows.sum()), split=split),
    ]


def recorded_precision(quick: bool) -> list[Row]:
    """float32 against float64 on the strides of recorded feet."""
    errors, feet = [], [item.inputs for items in sets(quick).values() for item in items]
    for inputs in feet:
        exact, rough = (estimated(FootParams(), given).strides for given in (inputs, single(inputs)))
        if len(exact.length) != len(rough.length):
            raise ValueError(f"float32 gave {len(rough.length)} strides, float64 {len(exact.length)}")
        errors.append(1e3 * np.abs(np.asarray(exact.length) - np.asarray(rough.length, np.float64)))
    if not errors:
        return []
    strides = np.concatenate(errors)
    show("float32 against float64 on recorded feet", ["feet", "strides", "median mm", "largest mm"],
         [[len(feet), strides.size, float(np.median(strides)), float(strides.max())]])  # fmt: skip
    split = f"{len(feet)} recorded feet"
    return [Row("float32_recorded_stride_mm", float(strides.max()), "mm", n=strides.size, split=split)]
