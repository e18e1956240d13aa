"""Simulated walks: the motion of the whole lower body, the readings of worn sensors, and the exact reference.

A `Person` (lengths of the body, parameters of the gait, each with its unit) walks along a `Route`. `recording` returns
records of the library; `walk` is the same in pure JAX, to be jitted, mapped over people and differentiated.
"""

from jgait.geometry.segments import segment_of
from jgait.simulate.breaks import with_breaks
from jgait.simulate.gaits import GAITS, walking
from jgait.simulate.person import RECORDED, Body, Gait, Person
from jgait.simulate.population import cohort, covering, gait, paced, person_of, population
from jgait.simulate.ranged import feet_range
from jgait.simulate.recorded import recording, trimmed, walks
from jgait.simulate.routes import Route, about_turn, circle, corner, faster, rectangle, route, straight, u_turn
from jgait.simulate.walker import plan
from jgait.simulate.worn import (
    FOUR,
    SEVEN,
    Truth,
    duration,
    mount,
    strides,
    walk,
)

__all__ = [
    "FOUR", "GAITS", "RECORDED", "SEVEN", "Body", "Gait", "Person", "Route", "Truth", "about_turn",
    "circle", "cohort", "corner", "covering", "duration", "faster", "feet_range", "gait", "mount",
    "paced", "person_of", "plan", "population", "recording", "rectangle", "route", "segment_of", "straight",
    "strides", "trimmed", "u_turn", "walk", "walking", "walks", "with_breaks",
]  # fmt: skip
