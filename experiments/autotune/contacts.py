"""Times of initial contacts at the waist (`ipol_gait`): settings of the soft detector tuned on other people."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from experiments.common.matching import nearest
from experiments.common.row import Row, show
from experiments.kose2011.contacts import TOLERANCE
from experiments.kose2011.walks import Walk, inside, of_set
from jgait import params, tune
from jgait.estimators import waist
from jgait.estimators.waist import motion
from jgait.events import trunk
from jgait.events.trunk_soft import SOFT, Soft, instants

SET = "ipol_gait"
SPLIT = "ipol_gait, people left out; start and centre of the priors from all of them"
RATE_HZ = 100.0
STEPS, STEP = 80, 0.05
WRONG = 0.005
"""[s] Errors much greater than this count in proportion to their size, not to its square."""

RANGES = Soft(
    forward=params.positive, upward=params.positive, blow=params.positive, temperature=params.positive,
    centre=params.interval(-0.15, 0.1), width=params.positive, offset=params.interval(-0.15, 0.1),
    loading=params.interval(-0.2, 0.4), cutoff_hz=params.positive,
)  # fmt: skip
VARIANTS = {"delay and its growth with the step": ("offset", "loading"), "all settings": Soft._fields}
"""What is free; the first, which was better on people left out, is reported in rows."""

PRIORS = Soft(
    *(params.lognormal(value, 2.0) for value in SOFT[:4]), params.normal(SOFT.centre, 0.02),
    params.lognormal(SOFT.width, 2.0), params.normal(SOFT.offset, 0.03), params.normal(SOFT.loading, 0.1),
    params.lognormal(SOFT.cutoff_hz, 1.5),
)  # fmt: skip


class Contacts(NamedTuple):
    """A walk's contacts that were found: accelerations (T,), and for each its coarse instant and true time (n,).

    Attributes:
        forward, upward: accelerations of the trunk [m/s²].
        measured: (T,) bool.
        coarse, true: (n,) [s] from the first sample.
        frequency: (n,) of steps [Hz].
        known: (n,) bool, False for padding.
    """

    forward: Any
    upward: Any
    measured: Any
    coarse: Any
    true: Any
    frequency: Any
    known: Any


def ready(walks: list[Walk]) -> Contacts:
    """The contacts of straight walking of each walk that the detector finds, padded to one length and stacked."""
    inputs = [waist.prepared(walk.recording).inputs for walk in walks]
    samples = max(len(one.time) for one in inputs)
    items = [_contacts(walk, one, samples) for walk, one in zip(walks, inputs, strict=True)]
    rows = max(item.true.size for item in items)

    def padded(item: Contacts) -> Contacts:
        signals, columns = item[:3], item[3:]
        return Contacts(*signals, *(np.pad(v, (0, rows - len(v)), mode="constant") for v in columns))

    return jax.tree.map(lambda *v: np.stack(v), *map(padded, items))


def _contacts(walk: Walk, inputs: Any, samples: int) -> Contacts:
    longer = waist.estimator().pad(inputs, samples)
    told = _found(longer)
    seen, found = (jax.tree.map(np.asarray, part) for part in told)
    start = float(walk.recording.sensors[next(iter(walk.recording.sensors))].time[0])
    rows = np.flatnonzero(found.valid)
    rows = rows[np.argsort(found.time[rows])]
    looked = inside(walk.contacts, walk.straight.looked)
    joined = [(rows[i], j) for i, j in nearest(found.time[rows] + start, walk.contacts, TOLERANCE) if looked[j]]
    mine, theirs = np.array(joined).T
    return Contacts(
        seen.forward, seen.upward, np.asarray(longer.measured), found.coarse[mine], walk.contacts[theirs] - start,
        found.step_frequency[mine], np.ones(len(mine), bool),
    )  # fmt: skip


@jax.jit
def _found(inputs: Any) -> Any:
    seen = motion.motion(waist.WaistParams(), inputs, smooth=False)
    return seen, trunk.initial_contacts(seen.forward, seen.upward, seen.yaw_rate, RATE_HZ, mask=inputs.measured)


def late(settings: Soft, item: Contacts) -> Any:
    """(n,) how late each contact is found [s], 0 in padding."""
    found = instants(item.forward, item.upward, RATE_HZ, item.coarse, item.frequency, settings, item.measured)
    return jnp.where(item.known, found - item.true, 0.0)


def loss(settings: Soft, item: Contacts) -> Any:
    """Sum over the walk's contacts; nearly the absolute error in units of `WRONG`."""
    return jnp.sum(jnp.sqrt(1.0 + (late(settings, item) / WRONG) ** 2) - 1.0)


@jax.jit
def absolute(settings: Soft, item: Contacts) -> Any:
    """Mean absolute error of the walk's contacts [ms]."""
    return 1e3 * jnp.sum(jnp.abs(late(settings, item))) / jnp.maximum(jnp.sum(item.known), 1)


def rows(quick: bool) -> list[Row]:
    """Contacts of every person by settings that the others taught."""
    walks = [] if quick else of_set(SET)
    if not walks:
        return []
    data, subjects, tables = ready(walks), [walk.subject for walk in walks], []
    count = data.known.sum(axis=1)
    for name, free in VARIANTS.items():
        found = tune.cross_validate(
            loss, SOFT, params.freed(RANGES, *free), data, optax.adam(STEP), subjects=subjects, error=absolute,
            priors=PRIORS, steps=STEPS, gradient="reverse",
        )  # fmt: skip
        tables.append(found)
        after = np.average(found.items["error_after"], weights=count)
        print(f"{name}: {after:.1f} ms; settings of the folds:", {
            field: np.round(np.asarray(getattr(found.params, field)), 3).tolist() for field in free
        })  # fmt: skip
    columns = ["left out", "walks", "before", *VARIANTS]
    lines = [
        [name, int(row["n"]), float(row["error_before"]), *(float(one.table["error_after"][name]) for one in tables)]
        for name, row in tables[0].table.iterrows()
    ]
    show("ipol_gait: time of initial contacts, mean error [ms]", columns, lines)
    line = "time of initial contacts at the waist, detector tuned on other people, `ipol_gait`: MAE"
    pairs = (("waist_ic_mae_ms", "error_after", "tuned"), ("waist_ic_mae_ms_before", "error_before", "default"))
    return [
        Row(name, float(np.average(tables[0].items[column], weights=count)), "ms", n=int(count.sum()),
            split=SPLIT if part == "tuned" else "ipol_gait, hand-chosen on these people").on(line, part, "contacts")
        for name, column, part in pairs
    ]  # fmt: skip
