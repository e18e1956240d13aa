"""What is tuned on simulated people alone, on recorded people: noise of a foot's filter, and contacts at the waist.

Both tunings begin where those on recorded people begin (`autotune.vicon`, `autotune.contacts`) and are judged on the
same walks. Simulated people move as recorded ones do: with a sensor on a shoe at speeds from a slow step to a fast walk
round a rectangle, where a quarter of them runs, and with an Opal sensor at the lower back on a straight way. A share is
the gain over that which tuning on other recorded people has, of the table of all experiments. What a foot learns
depends on the people who were drawn: its gain is the mean over several draws.
"""

from typing import NamedTuple

import jax
import numpy as np
import optax

from experiments.autotune import contacts, learn, vicon, walks
from experiments.autotune.evidence import independent
from experiments.common import summary
from experiments.common.row import Row
from experiments.kose2011.walks import Windows, of_set
from jgait import params, simulate, tune
from jgait.estimators.foot_ins import FootParams
from jgait.events.trunk import Soft
from jgait.geometry.segments import in_world
from jgait.simulate import Person, Route, Truth
from jgait.simulate.population import paced
from jgait.simulate.sensors import ON_SHOE, OPAL, ImuErrors
from jgait.types import Feet, FootTrajectory, Legs, Recording, Walk, as_float

FACTORS = (0.65, 1.2)
"""[1] Smallest and largest length of the stride over the person's usual one; speed changes by the square."""
RUNS = 4
"""[1] Of so many people one runs."""
AROUND, AHEAD = simulate.rectangle(5.0, 3.0), simulate.straight(20.0)
FOOT_HZ = 200.0
PEOPLE, DRAWS = 32, 3
"""[1] Simulated people with a sensor on a shoe of each draw, and the number of draws."""


class Known(NamedTuple):
    """A simulated walk with its contacts, as `contacts.ready` takes it."""

    recording: Recording
    contacts: np.ndarray
    straight: Windows


def walked(
    number: int, person: Person, along: Route, rate_hz: float, placement: str, errors: ImuErrors
) -> tuple[Recording, Truth]:
    """One simulated walk with one sensor."""
    key = jax.random.fold_in(jax.random.key(61), number)
    who = simulate.covering(key, person, along)
    return simulate.recording(key, who, along, errors, rate_hz, placements=(placement,))


def drawn(people: int, draw: int = 0) -> list[Person]:
    """People who move as recorded ones do."""
    every = simulate.population(jax.random.key(60 + 100 * draw), people, recorded=True)
    return [simulate.person_of(every, i) for i in range(people)]


def walkers(people: int, errors: ImuErrors = ON_SHOE, draw: int = 0, *, runs: bool = False) -> list[Walk]:
    """Walks at rising speeds with the right foot's path; with `runs`, every fourth person runs."""
    found = []
    for i, (person, factor) in enumerate(zip(drawn(people, draw), np.linspace(*FACTORS, people), strict=True)):
        who = simulate.walking(person, "running") if runs and i % RUNS == RUNS - 1 else paced(person, float(factor))
        recording, truth = walked(i + draw * people, who, AROUND, FOOT_HZ, "foot_right", errors)
        place = in_world(truth.motion.pose.foot_right, simulate.mount(person.body, "foot_right"))
        path = FootTrajectory(np.stack([as_float(part) for part in place], axis=1), None, None)
        found.append(Walk(recording, truth.estimate._replace(legs=Legs(None, None), feet=Feet(path, None)), {}))
    return found


def of_foot(quick: bool) -> list[Row]:
    """The gain in the position of a foot under Vicon."""
    here = walks.trials(quick)
    if here is None:
        return []
    days, people = sorted(set(here.days.tolist())), 2 if quick else PEOPLE

    def errors(p: FootParams) -> np.ndarray:
        return vicon.of_days(dict.fromkeys(days, p), quick)

    before, gains = errors(learn.START), []
    for draw in range(1 if quick else DRAWS):
        groups = walks.groups(walkers(people, draw=draw, runs=True))
        learned = learn.fit(groups, np.ones(people), steps=2 if quick else learn.STEPS).params
        after = errors(learned)
        gains.append(vicon.gain(before, after))
        medians = {
            kind: [float(np.median(one[here.kinds == kind]).round(3)) for one in (before, after)]
            for kind in walks.KINDS if (here.kinds == kind).any()
        }  # fmt: skip
        print({name: float(f"{float(getattr(learned, name)):.3g}") for name in learn.FREE},
              f"gain {gains[-1]:.3f}; medians before and after [m]: {medians}", flush=True)  # fmt: skip
    split = f"pyshoe_vicon, {len(gains)} times {people} simulated people"
    line = "gain in the mean logarithm of the position's error, from the textbook's filter on, `pyshoe_vicon`"
    part = "tuned on simulated people alone"
    return [
        Row("transfer_gain_position", float(np.mean(gains)), "1", None, len(before), split).on(line, part, "trials"),
        Row("transfer_gain_position_least", min(gains), "1", None, len(before), split).on(
            line, f"{part}, least of {len(gains)} draws", "trials"
        ),
    ]


def waists(people: int) -> list[Known]:
    """Straight walks with a sensor at the lower back."""
    found = []
    for i, person in enumerate(drawn(people)):
        recording, truth = walked(i, person, AHEAD, contacts.RATE_HZ, "lower_back", OPAL)
        times = np.sort(as_float(truth.strides.end)[np.asarray(truth.strides.valid)])
        window = np.array([[times[1] - 0.1, times[-2] + 0.1]])  # without the first step and the closing one
        found.append(Known(recording, times, Windows(window, window)))
    return found


def of_waist(quick: bool) -> list[Row]:
    """The gain in the times of contacts at the waist."""
    judged = [] if quick else of_set(contacts.SET)
    if not judged:
        return []
    data, made = contacts.ready(judged), contacts.ready(waists(16))
    late = np.asarray(jax.vmap(lambda item: contacts.late(contacts.START, item))(made))
    people = np.repeat(np.arange(len(late))[:, None], late.shape[1], axis=1)
    weight = independent(late[made.known], people[made.known])
    learned = tune.fit(
        contacts.loss_of(weight), contacts.START, params.freed(contacts.RANGES, *Soft._fields[:-1]), made,
        optax.adam(optax.cosine_decay_schedule(contacts.STEP, contacts.STEPS)), priors=contacts.PRIORS,
        steps=contacts.STEPS,
    ).params  # fmt: skip
    count = data.known.sum(axis=1)

    def mean(settings: Soft) -> float:
        each = jax.vmap(lambda item: contacts.absolute(settings, item))(data)
        return float(np.average(np.asarray(each), weights=count))

    before, after = mean(contacts.START), mean(learned)
    print(f"settings {jax.tree.map(lambda v: round(float(v), 3), learned)}: {before:.2f} to {after:.2f} ms")
    line, split = "time of initial contacts at the waist, `ipol_gait`: MAE", "ipol_gait, 16 simulated people"
    n = int(count.sum())
    return [
        Row("transfer_ic_mae_ms", after, "ms", None, n, split).on(
            line, "learned on simulated people alone", "contacts"
        ),
        Row("transfer_ic_mae_ms_before", before, "ms", None, n, "ipol_gait").on(
            line, "start of the learning", "contacts"
        ),
    ]


def rows(quick: bool) -> list[Row]:
    """Gains on both sets, and the smaller share of the gain of tuning on recorded people."""
    found = [*of_foot(quick), *of_waist(quick)]
    known = {row["metric"]: row["value"] for one in summary.load().values() for row in one["rows"]}
    here, shares = {row.metric: row.value for row in found}, {}
    if "transfer_gain_position" in here and "position_gain_tuned" in known:
        shares["pyshoe_vicon"] = here["transfer_gain_position"] / known["position_gain_tuned"]
    if "transfer_ic_mae_ms" in here and "waist_ic_mae_ms" in known:
        before = here["transfer_ic_mae_ms_before"]
        shares["ipol_gait"] = (before - here["transfer_ic_mae_ms"]) / (before - known["waist_ic_mae_ms"])
    line = "gain of tuning on simulated people alone over that of tuning on recorded people"
    for name, share in shares.items():
        row = Row(f"transfer_share_{name}", share, "1", None, 1, f"{name}, judged on recorded people")
        found.append(row.on(line, name, "sets"))
    if shares and not quick:
        row = Row("transfer_share", min(shares.values()), "1", None, len(shares), "the smaller of both sets")
        found.append(row.on(line, "smaller", "sets"))
    return found
