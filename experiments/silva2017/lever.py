"""The default estimator on real legs: the filter with the lever among its states, judged on legs not learned from.

Only the lever with which the filter starts is learned, on the other speed, the other leg or other people. Lengths are
nearly linear in it: the best lever follows from two levers, and the filter runs again with it.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.row import Row, show
from experiments.common.shanks import Leg
from experiments.silva2017.detect import pairs
from experiments.silva2017.groups import WHERE, length_line, measured_groups, turn_line
from jgait.estimators import ankle_stride
from jgait.estimators.ankle_stride import AnkleOptions, AnkleParams
from jgait.estimators.ankle_stride.prepare import AnkleInputs, prepare
from jgait.estimators.interface import pad
from jgait.geometry.rotation import turn
from jgait.types import Recording

BIAS = 0.02  # [rad/s]
ANGLE = 25.0  # [deg]
REFERENCE_SD = {"tripod": 0.025, "walking5m": 0.045}  # [m] of the reference, by three-cornered hat; Vicon's is small
AT_ANKLE = ("neura_ankle", "simulated")
LEVERS = {"neura_ankle": (0.02, 0.1)}
BOTH_LEVERS = (0.08, 0.18)
SAMPLES, SIDE_BY_SIDE = 4096, 4  # recordings are padded to multiples, and so many run at once
GRID = np.linspace(-0.04, 0.34, 77)
EXPECTED = (0.1, 0.1)  # [m] of the lever before any data, and its standard deviation
LEARNED_SD = {"tripod": 0.005, "simulated": 0.005}  # [m] of a lever learned on, or taped to, the same sensor
STRIDE_SD, WRONG = 0.03, 0.02  # [m] of a stride against a reference; from there on errors count less
SPLITS = {
    "tripod": "filter, lever learned at the other speed",
    "neura_ankle": "filter, lever learned on the other leg",
    "neura_shank": "filter, lever learned on the other leg",
    "walking5m": "filter, lever learned on other people",
}


def prepared(leg: Leg, off: np.ndarray, matrix: np.ndarray, *, standing: bool = True) -> AnkleInputs:
    """A leg as the filter takes it, in the place of the right one, turned on the leg and with a bias put in."""
    gyr, acc = ((np.asarray(v)) @ matrix.T for v in (leg.imu.gyr, leg.imu.acc))
    name = f"{'ankle' if leg.group in AT_ANKLE else 'shank'}_{leg.side}"
    sensors = {name: leg.imu._replace(gyr=gyr + off, acc=acc)}
    recording = Recording(sensors, leg.rate_hz, leg.walk, leg.subject)
    inputs = prepare(recording, AnkleOptions(standing=standing)).inputs
    return AnkleInputs(inputs.time, inputs.right if inputs.right is not None else inputs.left, None)


def together(items: list[AnkleInputs]) -> AnkleInputs:
    """Legs of a set, padded to one length."""
    samples = SAMPLES * int(np.ceil(max(item.time.size for item in items) / SAMPLES))
    return jax.tree.map(lambda *v: np.stack(v), *(pad(item, samples) for item in items))


@jax.jit
@jax.vmap
def _measured_with(lever: Any, spread: Any, inputs: AnkleInputs) -> dict[str, Any]:
    p = AnkleParams(lever_ankle=lever, lever_shank=lever, lever_along_sd=spread)
    told = ankle_stride.run(p, inputs)
    return {
        "length": told.strides.length,
        "valid": told.strides.valid,
        "sd": told.strides_stddev.length,
        "rise": told.strides.height,
        "lever": told.diagnostics["lever_right"][2],
    }


def run(name: str, levers: np.ndarray, inputs: AnkleInputs) -> dict[str, np.ndarray]:
    """(legs,) levers [m] → lengths, whether each is one, its deviation and rise (legs, n), lever found (legs,) [m].

    Some at a time, the last of them filled up, so that sets of all sizes share a program; two such at once, since one
    keeps no more than one core busy.
    """
    spread = np.full(SIDE_BY_SIDE, LEARNED_SD.get(name, float(AnkleParams().lever_along_sd)))

    def part(first: int) -> dict[str, np.ndarray]:
        rows = np.minimum(np.arange(first, first + SIDE_BY_SIDE), len(levers) - 1)
        told = _measured_with(levers[rows], spread, jax.tree.map(lambda v: v[rows], inputs))
        return jax.tree.map(np.asarray, told)

    parts = [part(0)]  # compiles
    with ThreadPoolExecutor(2) as pool:
        parts += pool.map(part, range(SIDE_BY_SIDE, len(levers), SIDE_BY_SIDE))
    return jax.tree.map(lambda *v: np.concatenate(v)[: len(levers)], *parts)


def references(legs: list[Leg], inputs: AnkleInputs) -> tuple[np.ndarray, np.ndarray]:
    """Length of each stride by the reference (legs, n) [m], 0 where there is none, and whether it is a whole one."""
    length, full = np.zeros(inputs.right.end.shape), np.zeros(inputs.right.end.shape, bool)
    for row, leg in enumerate(legs):
        count, reference = int(inputs.right.count[row]), leg.reference
        for i, j in pairs(inputs.right.lands[row, :count], reference.contact):
            length[row, i], full[row, i] = np.nan_to_num(reference.length[j]), reference.full[j]
            if reference.positions is not None:
                begin, end = (reference.positions[at[row, i]] for at in (inputs.right.begin, inputs.right.end))
                length[row, i] = np.linalg.norm(end - begin)
    return length, full & (length > 0.0)


def lever_of(pair: tuple[float, float], told: list[np.ndarray], true: np.ndarray, looked: np.ndarray) -> float:
    """The lever [m] that makes strides least wrong, by what two levers made of them."""
    share = (GRID - pair[0]) / (pair[1] - pair[0])
    error = told[0][looked] - true[looked] + share[:, None] * (told[1] - told[0])[looked]
    cost = np.sum(WRONG * np.sqrt(error**2 + WRONG**2), axis=1) / STRIDE_SD**2
    return float(GRID[np.argmin(cost + 0.5 * ((GRID - EXPECTED[0]) / EXPECTED[1]) ** 2)])


def held_out(name: str, legs: list[Leg], key: np.ndarray, inputs: AnkleInputs) -> np.ndarray:
    """(legs,) lever of each leg, learned on the legs of other keys [m]."""
    pair = LEVERS.get(name, BOTH_LEVERS)
    told = [run(name, np.full(len(legs), lever), inputs)["length"] for lever in pair]
    true, full = references(legs, inputs)
    return np.array([lever_of(pair, told, true, full & (key != one)[:, None]) for one in key])


def total(length: np.ndarray, looked: np.ndarray) -> np.ndarray:
    """(legs,) sum of a leg's whole strides [m]."""
    return np.where(looked, length, 0.0).sum(axis=1)


def lengths_rows(
    name: str, legs: list[Leg], told: dict[str, np.ndarray], true: np.ndarray, full: np.ndarray, levers: np.ndarray
) -> tuple[list[Row], list[Any]]:
    """Errors of a set's strides, and a line of a table."""
    error = told["length"] - true
    each, off = error[full], total(told["length"], full) / total(true, full) - 1.0
    mae, worst = 100.0 * float(np.mean(np.abs(each))), 100.0 * float(np.max(np.abs(off)))
    spread = np.sqrt(told["sd"] ** 2 + REFERENCE_SD.get(name, 0.0) ** 2)[full]
    inside = 100.0 * float(np.mean(np.abs(each) < 2.0 * spread))
    mean, half = 100.0 * float(np.mean(np.abs(off))), 100.0 * float(np.mean(np.abs(error[true > 0.0])))
    worst_name = "tripod_distance_error_pct_max" if name == "tripod" else f"{name}_distance_error_pct_max"
    split, line = SPLITS[name], f"distance, filter, lever learned on others, {WHERE[name]}: error"
    rows = [
        Row(f"{name}_stride_mae_cm", mae, "cm", n=each.size, split=split).on(length_line(name), "filter", "strides"),
        Row(f"{name}_distance_error_pct", mean, "%", n=len(legs), split=split).on(line, "mean", "legs"),
        Row(worst_name, worst, "%", n=len(legs), split=split).on(line, "worst", "legs"),
        Row(f"{name}_coverage_2sd_pct", inside, "%", n=each.size, split="stated deviation and the reference's"),
        Row(f"{name}_stated_sd_cm", 100.0 * float(np.mean(told["sd"][full])), "cm", n=each.size),
    ]
    groups = np.array([leg.group for leg in legs])
    for group in sorted(set(groups.tolist()) - {name}):
        of = full & (groups == group)[:, None]
        value = 100.0 * float(np.mean(np.abs(error[of])))
        rows.append(Row(f"{group}_stride_mae_cm", value, "cm", n=int(of.sum()), split=split))
    found = f"{told['lever'].min():.3f}–{told['lever'].max():.3f}"
    rise = 100.0 * float(np.std(told["rise"][full]))
    learned = f"{levers.min():.3f}–{levers.max():.3f}"
    return rows, [name, mae, 100.0 * float(np.mean(each)), mean, worst, half, inside, rise, learned, found]


def bias_rows(name: str, legs: list[Leg], levers: np.ndarray, full: np.ndarray, plain: np.ndarray) -> list[Row]:
    """How far a leg's total moves with 0.02 rad/s on each axis, when only the filter can estimate it."""
    moved = []
    for off in BIAS * np.eye(3):
        inputs = together([prepared(leg, off, np.eye(3), standing=False) for leg in legs])
        same = inputs.right.count == np.sum(plain > 0.0, axis=1)
        looked = full & same[:, None]
        change = total(run(name, levers, inputs)["length"], looked) / np.maximum(total(plain, looked), 1e-9) - 1.0
        moved.append(100.0 * np.abs(change)[same])
    every = np.concatenate(moved)
    split = "filter, each axis, bias not read at rest"
    return [
        Row(f"bias_002_{name}_filter_change_pct", float(np.mean(every)), "%", n=every.size, split=split),
        Row(f"bias_002_{name}_filter_change_pct_max", float(np.max(every)), "%", n=every.size, split=split),
    ]


def rotation_row(name: str, legs: list[Leg], levers: np.ndarray, full: np.ndarray, plain: np.ndarray) -> Row:
    """Change of a stride's length when the sensor is turned on the leg, unknown to the filter."""
    axes = np.random.default_rng(0).normal(size=(len(legs), 3))
    matrices = [np.asarray(turn(jnp.asarray(axis), np.deg2rad(ANGLE))) for axis in axes]
    inputs = together([prepared(leg, np.zeros(3), m) for leg, m in zip(legs, matrices, strict=True)])
    change = 100.0 * float(np.mean(np.abs(run(name, levers, inputs)["length"] - plain)[full]))
    row = Row(f"rotation25_{name}_filter_change_cm", change, "cm", n=int(full.sum()), split="filter, random axes")
    return row.on(turn_line(name), "filter", "strides")


def filtered(found: dict[str, tuple[list[Leg], np.ndarray, Any]], quick: bool) -> list[Row]:
    """The filter on every set: lengths, coverage, and, unless quick, bias put in and the sensor turned."""
    rows, lines = [], []
    for name, (legs, key, _) in found.items():
        if len(set(key.tolist())) < 2:
            continue
        inputs = together([prepared(leg, np.zeros(3), np.eye(3)) for leg in legs])
        levers = held_out(name, legs, key, inputs)
        told = run(name, levers, inputs)
        true, full = references(legs, inputs)
        some, line = lengths_rows(name, legs, told, true, full, levers)
        rows, lines = rows + some, [*lines, line]
        if quick:
            continue
        free = together([prepared(leg, np.zeros(3), np.eye(3), standing=False) for leg in legs])
        unread = run(name, levers, free)["length"]
        rows += bias_rows(name, legs, levers, full, np.where(_there(free), unread, 0.0))
        rows.append(rotation_row(name, legs, levers, full, told["length"]))
    columns = ["", "MAE cm", "mean cm", "total %", "worst %", "with half-steps", "within 2 SD %", "rise SD cm",
               "lever learned [m]", "found"]  # fmt: skip
    show("The filter: whole strides, lever learned on others", columns, lines)
    for metric, unit, kind in (("bias_002_distance_change_pct", "%", "_filter_change_pct"),
                               ("rotation25_change_cm", "cm", "_filter_change_cm")):  # fmt: skip
        values = [row.value for row in rows if row.metric.startswith(metric[:8]) and row.metric.endswith(kind)]
        if values:
            rows.append(Row(metric, max(values), unit, n=len(values), split="filter, worst set"))
    return rows


def _there(inputs: AnkleInputs) -> np.ndarray:
    return np.arange(inputs.right.end.shape[1])[None, :] < inputs.right.count[:, None]


def rows(quick: bool) -> list[Row]:
    """On the sets that are here."""
    return filtered(measured_groups(quick), quick)
