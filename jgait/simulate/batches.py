"""Walks of many people, simulated in batches that share one compilation."""

from collections.abc import Iterator, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray, PyTree, Shaped

from jgait.simulate.check import check_sensors, check_slack, check_values
from jgait.simulate.person import Person
from jgait.simulate.population import fitted, person_of, population
from jgait.simulate.routes import Route, straight
from jgait.simulate.sensors import IDEAL, ImuErrors
from jgait.simulate.worn import SEVEN, Truth, limits, room, roomy, samples_in, trimmed, walk
from jgait.types import AnyArray, Recording


@partial(jax.jit, static_argnames=("capacity", "placements"))
def _walks(
    keys: Shaped[Array, "person ..."],
    people: Person,
    along: Route,
    time: Float[AnyArray, "time"],
    errors: ImuErrors,
    capacity: int,
    placements: tuple[str, ...],
) -> PyTree:
    def one(key: PRNGKeyArray, person: Person, way: Route) -> PyTree:
        return walk(key, person, way, time, errors, capacity=capacity, placements=placements)

    return jax.vmap(one)(keys, people, along)


def walks(
    keys: Sequence[PRNGKeyArray], people: Sequence[Person], along: Sequence[Route], errors: ImuErrors = IDEAL,
    rate: float = 100.0, placements: Sequence[str] = SEVEN, *, names: Sequence[str] | None = None, batch: int = 16,
) -> Iterator[tuple[Recording, Truth]]:  # fmt: skip
    """Simulate a walk of each of several people, in batches that share one compilation; walks are returned one by one.

    Args:
        keys: one PRNG key for each person, the same as for `fitted`.
        people: persons whose fields are floats.
        along: the route of each person; all routes have the same number of pieces.
        errors: errors and mounting of the sensors.
        rate: sampling rate [Hz].
        placements: where sensors are worn, see `jgait.PLACEMENTS`.
        names: of recording and subject; None for subject_0001 …
        batch: number of people simulated at once; memory grows with it.

    Yields:
        The recording, and the truth at the same times, in NumPy arrays.

    Raises:
        TypeError, ValueError: as `recording`, before anything is simulated; the message names the recording of whom the
            route asks more than the legs can do.
    """
    if not (len(keys) == len(people) == len(along) > 0):
        raise ValueError(f"walks needs a key and a route for each person; got {len(keys)}, {len(along)}, {len(people)}")
    check_sensors(errors, rate, placements)
    for person in people:
        check_values(person)
    names = [f"subject_{i + 1:04d}" for i in range(len(people))] if names is None else names
    lasts = []
    for key, person, way, name in zip(keys, people, along, names, strict=True):
        last, left = limits(key, person, way)
        check_slack(person, left, f"on the route of {name}")
        lasts.append(last)
    return _one_by_one(keys, people, along, lasts, errors, rate, tuple(placements), names, batch)


def _one_by_one(
    keys: Sequence[PRNGKeyArray], people: Sequence[Person], along: Sequence[Route], lasts: Sequence[float],
    errors: ImuErrors,
    rate: float, placements: tuple[str, ...], names: Sequence[str], batch: int,
) -> Iterator[tuple[Recording, Truth]]:  # fmt: skip
    capacity = room(max(round(float(person.gait.steps)) for person in people))
    batch = min(batch, len(people))
    samples = [samples_in(last, rate) for last in lasts]
    time = jnp.asarray(np.arange(roomy(max(samples))) / rate)
    for start in range(0, len(people), batch):
        # The last batch is filled up with copies of its last person.
        chosen = [min(i, len(people) - 1) for i in range(start, start + batch)]
        members = ([items[i] for i in chosen] for items in (people, along))
        who, where = (jax.tree.map(lambda *v: jnp.asarray(np.stack(v)), *member) for member in members)
        together = _walks(jnp.stack([keys[i] for i in chosen]), who, where, time, errors, capacity, placements)
        read, true = jax.tree.map(np.asarray, together)
        for i in range(start, min(start + batch, len(people))):
            own = jax.tree.map(lambda leaf, k=i - start: leaf[k], (read, true))
            worn, known = trimmed(own[0], own[1], samples[i])
            yield Recording({name: worn[name] for name in placements}, rate, names[i], names[i]), known


def cohort(
    key: PRNGKeyArray, n: int, along: Route | None = None, errors: ImuErrors = IDEAL, rate: float = 100.0,
    placements: Sequence[str] = SEVEN, *, batch: int = 16,
) -> list[tuple[Recording, Truth]]:  # fmt: skip
    """Simulate one walk of each of `n` people drawn from `population`, with individual steps along the same route.

    The truth of a minute at 100 Hz takes some 12 MB; for many people, use `walks`, which returns walks one by one.

    Args:
        key: PRNG key of the people, their variability and the sensors' errors.
        n: number of people.
        along: the route; None for 20 m straight ahead.
        errors: errors and mounting of the sensors.
        rate: sampling rate [Hz].
        placements: where sensors are worn, see `jgait.PLACEMENTS`.
        batch: number of people simulated at once.

    Returns:
        Recording and truth of each person, with the names subject_0001 and so on.

    Raises:
        ValueError: if `n` is not positive, or as `walks`.
    """
    along = straight(20.0) if along is None else along
    who, how = jax.random.split(key)
    people = population(who, n)
    keys = [jax.random.fold_in(how, i) for i in range(n)]
    fit = [fitted(one, person_of(people, i), along) for i, one in enumerate(keys)]
    return list(walks(keys, fit, [along] * n, errors, rate, placements, batch=batch))
