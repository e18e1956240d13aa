"""The ankle's estimator a sample at a time: time of a sample, and real strides beside those of the whole recording.

A sample's cost is that of the compiled step in a long scan, and of a call of it from Python: with its state as it is
(some 230 arrays, most of the covariance), and packed into one array a type, since each array costs a call a
microsecond or more. Most of the time of such a call is Python's and the runtime's: it is measured again without
the step. Lengths are judged with the lever that the offline filter learned on other recordings.
"""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.row import Row, show
from experiments.common.sets import datasets
from experiments.common.shanks import Leg
from experiments.silva2017.detect import f1, pairs, score
from experiments.silva2017.groups import load, measured
from experiments.silva2017.lever import LEARNED_SD, held_out, prepared, together
from jgait.estimators import ankle_stride
from jgait.estimators.ankle_stride import AnkleOptions, AnkleParams
from jgait.estimators.ankle_stride import online as ankle_online
from jgait.estimators.lagged import LaggedNow
from jgait.estimators.online.device import Structure, packed, unpacked
from jgait.geometry.arrays import compiler_options
from jgait.types import Imu, Recording, Strides

SAMPLES, CALLS, REPEATS, HZ = 40_000, 3000, 9, 100.0


def made() -> Recording:
    """Six seconds of a leg that stands and swings, for timing alone."""
    t = np.arange(600) / HZ
    rate = np.zeros_like(t)
    for k in range(4):
        at = 1.4 + 1.1 * k
        rate -= 5.0 * np.exp(-0.5 * ((t - at) / 0.1) ** 2)
        rate += sum(2.0 * np.exp(-0.5 * ((t - at - off) / 0.08) ** 2) for off in (-0.26, 0.26))
    gyr = np.stack([0.02 * np.sin(9.0 * t), rate, 0.02 * np.cos(7.0 * t)], axis=1)
    acc = np.stack([0.1 * rate, 0.0 * t, 9.81 + 0.1 * rate**2], axis=1)
    return Recording({"ankle_right": Imu(t, gyr, acc, np.ones(t.size, bool))}, HZ, "made")


def in_dtype(tree: Any, dtype: Any) -> Any:
    """The tree with floats of a type."""
    return jax.tree.map(lambda v: jnp.asarray(v, dtype if np.result_type(v) == np.float64 else np.result_type(v)), tree)


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """`jax.jit`, for the widest vectors."""
    return jax.jit(function, compiler_options=compiler_options() or None, **options)


over = compiled(ankle_online.over)


def walk(p: AnkleParams, worn: Any, gyr: Any, acc: Any, measured: Any = None) -> LaggedNow:
    """The results after each sample (T,) of a recording, by the device's `begin` and `over`; arguments as of these."""
    return over(p, worn, ankle_online.begin(p, worn, gyr[0], acc[0]), gyr, acc, measured)[1]


def table(now: LaggedNow) -> tuple[Strides, Strides, dict[str, Any]]:
    """Strides (n,) among the results, their standard deviations, and flags with `known`, the sample at which each
    became known."""
    at = np.flatnonzero(np.asarray(now.stride))
    strides, stddev, flags = jax.tree.map(lambda leaf: np.asarray(leaf)[at], (now.strides, now.stddev, now.flags))
    return strides, stddev, {**flags, "known": at}


def scan_us(p: AnkleParams, worn: Any, state: Any, gyr: Any, acc: Any, repeats: int) -> float:
    """Median microseconds a sample in a scan, strides written out."""
    jax.block_until_ready(over(p, worn, state, gyr, acc))
    took = []
    for _ in range(repeats):
        begin = time.perf_counter()
        jax.block_until_ready(over(p, worn, state, gyr, acc))
        took.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(took)) / len(gyr)


def call_us(step: Callable[..., Any], state: Any, gyr: Any, acc: Any, calls: int) -> float:
    """Median microseconds of a call from Python, the state given back, a tenth of the calls to warm up."""
    took = []
    for k in range(calls):
        one, two = gyr[k % len(gyr)], acc[k % len(acc)]
        begin = time.perf_counter()
        state, told = step(state, one, two)
        jax.block_until_ready((state, told))
        took.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(took[calls // 10 :]))


class Calls(NamedTuple):
    """Microseconds of a call: with the state as it is, packed, and packed with the step left out."""

    tree: float
    packed: float
    empty: float


def calls_us(p: AnkleParams, worn: Any, state: Any, gyr: Any, acc: Any, calls: int) -> Calls:
    """What calls of one step from Python take."""

    def plain(state: Any, gyr: Any, acc: Any) -> Any:
        state, now = ankle_online.over(p, worn, state, gyr[None], acc[None])
        return state, (now.stride[0], now.strides.length[0])

    structure = Structure.of(state)

    def small(parts: Any, gyr: Any, acc: Any, times: Any) -> Any:
        # in a loop, even one that turns once, the step is one compiled function, as in a scan
        def turn(_: Any, carried: Any) -> Any:
            after, told = plain(unpacked(carried[0], structure), gyr, acc)
            return packed(after), told

        zero = jnp.zeros_like(gyr[0])
        return jax.lax.fori_loop(0, times, turn, (parts, (jnp.asarray(False), zero)))

    readings = list(np.asarray(gyr[:500])), list(np.asarray(acc[:500]))
    tree = call_us(compiled(plain, donate_argnums=0), jax.tree.map(jnp.array, state), *readings, calls)
    step = compiled(small, donate_argnums=0)

    def timed(times: int) -> float:
        count = np.int32(times)
        return call_us(lambda s, g, a: step(s, g, a, count), packed(state), *readings, calls)

    return Calls(tree, timed(1), timed(0))


def cost(quick: bool) -> list[Row]:
    """Microseconds a sample of the whole estimator."""
    samples, calls, repeats = (2000, 200, 3) if quick else (SAMPLES, CALLS, REPEATS)
    recording = made()
    imu = recording.sensors["ankle_right"]
    device = ankle_online.worn(AnkleParams(), recording, "right")
    rows, lines = [], []
    for dtype in (np.float64, np.float32):
        p, worn = in_dtype((AnkleParams(*map(np.float64, AnkleParams())), device), dtype)
        index = np.arange(samples) % len(imu.time)
        gyr, acc = (jnp.asarray(np.asarray(values)[index], dtype) for values in (imu.gyr, imu.acc))
        state = ankle_online.begin(p, worn, gyr[0], acc[0])
        size = sum(leaf.nbytes for leaf in jax.tree.leaves(state))
        scanned = scan_us(p, worn, state, gyr, acc, repeats)
        called = calls_us(p, worn, state, gyr, acc, calls)
        name = "" if dtype == np.float64 else "_float32"
        rows += [
            Row(f"online_step_us{name}", scanned, "µs", n=samples, split="a sample in a scan, compiled"),
            Row(f"online_call_us{name}", called.packed, "µs", n=calls, split="from Python, state packed and donated"),
            Row(f"online_call_empty_us{name}", called.empty, "µs", n=calls, split="such a call without the step"),
            Row(f"online_call_device_us{name}", called.packed - called.empty, "µs", n=calls, split="their difference"),
            Row(f"online_call_tree_us{name}", called.tree, "µs", n=calls, split="a call with the state as it is"),
            Row(f"online_state_bytes{name}", float(size), "bytes", split=f"at {HZ:g} Hz"),
        ]
        lines.append([np.dtype(dtype).name, scanned, called.packed, called.empty, called.tree, size])
    columns = ["", "scan", "call, packed", "without the step", "call, state as it is", "state [bytes]"]
    show("One sample of the whole estimator [µs]", columns, lines)
    return rows


def device_walk(leg: Leg, p: AnkleParams) -> tuple[Strides, Strides]:
    """Strides of a leg a sample at a time, and with the whole recording; what the sensor looks like from that."""
    name = f"{'ankle' if leg.group == 'neura_ankle' else 'shank'}_{leg.side}"
    recording = Recording({name: leg.imu}, leg.rate_hz, leg.walk, leg.subject)
    worn = ankle_online.worn(p, recording, leg.side)
    count = len(leg.imu.time)
    padded = 1024 * 2 ** int(np.ceil(np.log2(max(count, 1024) / 1024)))
    index = np.minimum(np.arange(padded), count - 1)
    now = walk(p, worn, np.asarray(leg.imu.gyr)[index], np.asarray(leg.imu.acc)[index])
    strides, _, flags = table(now)
    mine = jax.tree.map(lambda column: column[flags["known"] < count], strides)
    start = float(np.asarray(leg.imu.time)[0])
    mine = mine._replace(**{name: getattr(mine, name) + start for name in ("start", "final_contact", "end")})
    return mine, ankle_stride.estimate(p, recording, AnkleOptions(smooth=False)).strides


def errors(leg: Leg, strides: Strides) -> np.ndarray:
    """Of the lengths of whole strides against the reference [m]."""
    reference = leg.reference
    joined = [(i, j) for i, j in pairs(strides.end, reference.contact) if reference.full[j]]
    return np.array([strides.length[i] - reference.length[j] for i, j in joined])


def of_set(name: str, legs: list[Leg], key: np.ndarray) -> tuple[list[Row], list[Any]]:
    """Lengths and detection of a set online, and lengths with the whole recording."""
    inputs = together([prepared(leg, np.zeros(3), np.eye(3)) for leg in legs])
    levers = held_out(name, legs, key, inputs)
    spread = LEARNED_SD.get(name, AnkleParams().lever_along_sd)
    both: tuple[list[np.ndarray], ...] = ([], [], [])
    scores = []
    for leg, lever in zip(legs, levers, strict=True):
        worn_at = "lever_ankle" if leg.group == "neura_ankle" else "lever_shank"
        inside = max(float(lever), 0.001)  # of a mid shank's range; a few legs may teach nonsense
        p = AnkleParams(lever_along_sd=spread)._replace(**{worn_at: inside})
        online, whole = device_walk(leg, p)
        scores.append(score(leg, online.end, half_steps=False))
        both[0].append(errors(leg, online))
        both[1].append(errors(leg, whole))
        near = [(i, j) for i, j in pairs(online.end, whole.end) if abs(online.end[i] - whole.end[j]) < 0.3]
        both[2].append(np.array([online.length[i] - whole.length[j] for i, j in near]))
    mae, offline, apart = (100.0 * float(np.mean(np.abs(np.concatenate(part)))) for part in both)
    n = sum(map(len, both[0]))
    split = "lever learned on others by the filter offline"
    rows = [
        Row(f"online_{name}_stride_mae_cm", mae, "cm", n=n, split=f"a sample at a time, {split}"),
        Row(f"online_{name}_offline_mae_cm", offline, "cm", n=n, split=f"whole recording, not smoothed, {split}"),
        Row(f"online_{name}_apart_cm", apart, "cm", n=sum(map(len, both[2])), split="the two beside each other"),
        Row(f"online_f1_{name}", f1(scores), "F1", n=n, split="whole strides"),
    ]
    missed, extra = (sum(one[k] for one in scores) for k in (1, 2))
    return rows, [name, mae, offline, apart, f1(scores), missed, extra, n]


def rows(quick: bool) -> list[Row]:
    """What a sample costs, and real strides a sample at a time."""
    rows, lines = cost(quick), []
    if not any(datasets.available(name) for name in ("tripod", "neura_sparse", "walking5m")):
        return rows
    found = measured(load(quick))
    for name, (legs, key, _) in found.items():
        if len(set(key.tolist())) < 2:
            continue
        some, line = of_set(name, legs, key)
        rows, lines = rows + some, [*lines, line]
    columns = ["", "MAE online cm", "whole recording cm", "apart cm", "F1", "missed", "extra", "n"]
    show("Real strides a sample at a time, whole ones, lever learned on others", columns, lines)
    return rows
