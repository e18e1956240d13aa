"""Times of initial contacts at the waist (`ipol_gait`): settings of the soft detector learned on other people.

The learning starts at settings that know nothing of these people, and its priors are centred there: equal weights, no
delay, a search about the coarse instant. Only the cut-off keeps its default, by which errors hardly change.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from experiments.autotune.evidence import independent
from experiments.common.matching import nearest
from experiments.common.row import Row, show
from experiments.kose2011.contacts import TOLERANCE
from experiments.kose2011.walks import Walk, inside, of_set
from jgait import params, tune
from jgait.estimators import waist
from jgait.estimators.interface import pad
from jgait.estimators.waist import motion
from jgait.events import trunk
from jgait.events.trunk import SOFT, Soft, cues, located

SET = "ipol_gait"
SPLIT = "ipol_gait, people left out, from settings that know none of them"
RATE_HZ = 100.0
STEPS, STEP = 150, 0.1
WRONG = 0.005
"""[s] Errors much greater than this count in proportion to their size, not to its square."""

START = Soft(temperature=1.0, centre=0.0, width=0.05, offset=0.0, loading=0.0)
"""Equal weights; a foot's contact is within a tenth of a second of the coarse instant."""

RANGES = Soft(
    forward=params.positive, upward=params.positive, blow=params.positive, temperature=params.positive,
    centre=params.interval(-0.15, 0.15), width=params.positive, offset=params.interval(-0.15, 0.15),
    loading=params.interval(-0.4, 0.4), cutoff_hz=params.positive,
)  # fmt: skip
VARIANTS = {
    "all settings": Soft._fields[:-1],
    "search and delay": ("centre", "width", "offset", "loading"),
    "delay": ("offset", "loading"),
}
"""What is free; the first is reported in rows."""

PRIORS = Soft(
    *(params.lognormal(value, 2.0) for value in START[:4]), params.normal(START.centre, 0.05),
    params.lognormal(START.width, 2.0), params.normal(START.offset, 0.05), params.normal(START.loading, 0.1),
    None,
)  # fmt: skip


class Contacts(NamedTuple):
    """A walk's contacts that were found: cues (T, 3), and for each contact its coarse instant and true time (n,).

    Attributes:
        cues: of the detector, see `trunk.cues`.
        coarse, true: (n,) [s] from the first sample.
        frequency: (n,) of steps [Hz].
        known: (n,) bool, False for padding.
    """

    cues: Any
    coarse: Any
    true: Any
    frequency: Any
    known: Any


def ready(walks: Sequence[Walk]) -> Contacts:
    """The contacts of straight walking of each walk that the detector finds, padded to one length and stacked."""
    inputs = [waist.prepared(walk.recording).inputs for walk in walks]
    samples = max(len(one.time) for one in inputs)
    items = [_contacts(walk, one, samples) for walk, one in zip(walks, inputs, strict=True)]
    rows = max(item.true.size for item in items)

    def padded(item: Contacts) -> Contacts:
        return Contacts(item.cues, *(np.pad(v, (0, rows - len(v)), mode="constant") for v in item[1:]))

    return jax.tree.map(lambda *v: np.stack(v), *map(padded, items))


def _contacts(walk: Walk, inputs: Any, samples: int) -> Contacts:
    longer = pad(inputs, samples)
    score, found = jax.tree.map(np.asarray, _found(longer))
    start = float(walk.recording.sensors[next(iter(walk.recording.sensors))].time[0])
    rows = np.flatnonzero(found.valid)
    rows = rows[np.argsort(found.time[rows])]
    looked = inside(walk.contacts, walk.straight.looked)
    joined = [(rows[i], j) for i, j in nearest(found.time[rows] + start, walk.contacts, TOLERANCE) if looked[j]]
    mine, theirs = np.array(joined).T
    return Contacts(
        score, found.coarse[mine], walk.contacts[theirs] - start, found.step_frequency[mine], np.ones(len(mine), bool)
    )


@jax.jit
def _found(inputs: Any) -> Any:
    seen = motion.motion(waist.WaistParams(), inputs, smooth=False)
    found = trunk.initial_contacts(seen.forward, seen.upward, seen.yaw_rate, RATE_HZ, mask=inputs.measured)
    return cues(seen.forward, seen.upward, RATE_HZ, SOFT.cutoff_hz, inputs.measured), found


def late(settings: Soft, item: Contacts) -> Any:
    """(n,) how late each contact is found [s], 0 in padding."""
    found = located(item.cues, RATE_HZ, item.coarse, item.frequency, settings)
    return jnp.where(item.known, found - item.true, 0.0)


@jax.jit
def absolute(settings: Soft, item: Contacts) -> Any:
    """Mean absolute error of the walk's contacts [ms]."""
    return 1e3 * jnp.sum(jnp.abs(late(settings, item))) / jnp.maximum(jnp.sum(item.known), 1)


def loss_of(weight: float) -> Callable[[Soft, Contacts], Any]:
    """The loss of a walk, where a contact counts as `weight` independent ones."""

    def loss(settings: Soft, item: Contacts) -> Any:
        """Sum over the walk's contacts; nearly the absolute error in units of `WRONG`."""
        return weight * jnp.sum(jnp.sqrt(1.0 + (late(settings, item) / WRONG) ** 2) - 1.0)

    return loss


def floors(errors: np.ndarray, people: np.ndarray) -> tuple[float, float]:
    """Mean absolute error [ms] with the median of all people taken off, and with everybody's own: what no setting that
    is the same for all people can fall below by far."""
    own = np.zeros_like(errors)
    for name in np.unique(people):
        own[people == name] = errors[people == name] - np.median(errors[people == name])
    return 1e3 * float(np.mean(np.abs(errors - np.median(errors)))), 1e3 * float(np.mean(np.abs(own)))


def rows(quick: bool) -> list[Row]:
    """Contacts of every person by settings that the others taught."""
    walks = [] if quick else of_set(SET)
    if not walks:
        return []
    data, subjects, tables = ready(walks), [walk.subject for walk in walks], []
    count = data.known.sum(axis=1)
    people = np.repeat(np.array(subjects)[:, None], data.known.shape[1], axis=1)[data.known]
    errors = {name: np.asarray(jax.vmap(lambda item, at=at: late(at, item))(data))[data.known]
              for name, at in (("start", START), ("default", SOFT))}  # fmt: skip
    weight = independent(errors["start"], people)
    print(f"a contact counts as {weight:.3f} independent ones")

    for name, free in VARIANTS.items():
        found = tune.cross_validate(
            loss_of(weight), START, params.freed(RANGES, *free), data,
            optax.adam(optax.cosine_decay_schedule(STEP, STEPS)), subjects=subjects, error=absolute,
            priors=PRIORS, steps=STEPS,
        )  # fmt: skip
        tables.append(found)
        after = np.average(found.items["error_after"], weights=count)
        print(f"{name}: {after:.2f} ms; settings of the folds:", {
            field: np.round(np.asarray(getattr(found.params, field)), 3).tolist() for field in free
        })  # fmt: skip
    default = np.array([float(absolute(SOFT, jax.tree.map(lambda v, i=i: v[i], data))) for i in range(len(walks))])
    named = {name: np.average(default[np.array(subjects) == name], weights=count[np.array(subjects) == name])
             for name in dict.fromkeys(subjects)}  # fmt: skip
    lines = [
        [name, int(row["n"]), float(named[name]), *(float(one.table["error_after"][name]) for one in tables)]
        for name, row in tables[0].table.iterrows()
    ]
    show("ipol_gait: time of initial contacts, mean error [ms]", ["left out", "walks", "default", *VARIANTS], lines)
    common, own = floors(errors["default"], people)
    print(f"default settings, less the median of all people: {common:.2f} ms; less everybody's own: {own:.2f} ms")
    line = "time of initial contacts at the waist, `ipol_gait`: MAE"
    of = int(count.sum())

    def mean(column: np.ndarray) -> float:
        return float(np.average(column, weights=count))

    return [
        Row("waist_ic_mae_ms", mean(tables[0].items["error_after"]), "ms", n=of, split=SPLIT).on(
            line, "learned on other people", "contacts"
        ),
        Row("waist_ic_mae_ms_before", mean(default), "ms", n=of, split="ipol_gait, chosen on these people").on(
            line, "default", "contacts"
        ),
        Row("waist_ic_mae_ms_own_delay", own, "ms", n=of, split="default, less everybody's own median").on(
            line, "with everybody's own delay", "contacts"
        ),
    ]
