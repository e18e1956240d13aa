"""Walks of many people, simulated one after another by one compiled program."""

from collections.abc import Iterator, Sequence

import jax
from jaxtyping import PRNGKeyArray

from jgait.simulate.check import check_sensors, check_slack, check_values
from jgait.simulate.person import Person
from jgait.simulate.population import covering, person_of, population
from jgait.simulate.recorded import limits, simulated
from jgait.simulate.routes import Route, straight
from jgait.simulate.sensors import IDEAL, ImuErrors
from jgait.simulate.worn import SEVEN, Truth
from jgait.types import Recording


def walks(
    keys: Sequence[PRNGKeyArray], people: Sequence[Person], along: Sequence[Route], errors: ImuErrors = IDEAL,
    rate: float = 100.0, placements: Sequence[str] = SEVEN, *, names: Sequence[str] | None = None,
) -> Iterator[tuple[Recording, Truth]]:  # fmt: skip
    """Simulate a walk of each of several people, one by one, all by one compiled program.

    `keys`, `people` (their fields floats) and `along` have one entry for each person, the key that of `covering`;
    `names` of recording and subject, None for subject_0001 … Other arguments as of `recording`.

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
    planned = []
    for key, person, way, name in zip(keys, people, along, names, strict=True):
        laid, last, left = limits(key, person, way)
        check_slack(person, left, f"on the route of {name}")
        planned.append((key, person, laid, last))

    def one_by_one() -> Iterator[tuple[Recording, Truth]]:
        for name, walk in zip(names, planned, strict=True):
            worn, true = simulated(*walk, errors, rate, placements)
            yield Recording(worn, rate, name, name), true

    return one_by_one()


def cohort(
    key: PRNGKeyArray, n: int, along: Route | list[Route] | None = None, errors: ImuErrors = IDEAL,
    rate: float = 100.0, placements: Sequence[str] = SEVEN, *, recorded: bool = True,
) -> list[tuple[Recording, Truth]]:  # fmt: skip
    """Simulate one walk of each of `n` people drawn from `population`, with individual steps along a route.

    `along` is the route of all people or a list with that of each; None is 20 m straight ahead. `recorded` as of
    `population`, other arguments as of `recording`. The truth of a minute at 100 Hz takes some 12 MB; for many people,
    use `walks`, which returns walks one by one.

    Returns:
        Recording and truth of each person, with the names subject_0001 and so on.

    Raises:
        ValueError: if `n` is not positive, or as `walks`.
    """
    ways = along if isinstance(along, list) else [straight(20.0) if along is None else along] * n
    who, how = jax.random.split(key)
    people = population(who, n, recorded)
    keys = [jax.random.fold_in(how, i) for i in range(n)]
    fit = [
        covering(walk_key, person_of(people, i), way) for i, (walk_key, way) in enumerate(zip(keys, ways, strict=True))
    ]
    return list(walks(keys, fit, ways, errors, rate, placements))
