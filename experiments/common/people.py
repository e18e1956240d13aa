"""Whether a person can walk with a gait at all."""

import jax

from jgait.simulate import Person, straight
from jgait.simulate.check import check_slack, check_values
from jgait.simulate.person import evenly
from jgait.simulate.recorded import limits


def check_person(person: Person) -> None:
    """Check that a person can walk with this gait, on level ground and with four even steps; raises as
    `simulate.recording`."""
    check_values(person)
    check_slack(person, limits(jax.random.key(0), evenly(person, 4), straight(10.0))[2], "on level ground")
