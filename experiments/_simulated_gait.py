"""Simulated walks as the sets of `_real_gait` are: the same speed, sampling rate, sensors and rules, the same figures.

Stance is told as each set's reader tells it: on `neura_sparse` by heel and toe slower than `RESTING`, else by the
simulator's own contacts. Sensors are perfect but for their range. Only the stride's time and length are taken from a
set, so what they fix (`GIVEN`) is no test of the simulator.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from _real_gait import RESTING, Figures, Spread, Truth, figures, pool

from jgait.kinematics import GRAVITY, Vector, in_world
from jgait.sensors import IDEAL, ImuErrors
from jgait.simulate import Gait, Person, straight, walk
from jgait.simulate.footsteps import FIRST
from jgait.types import SIDES

GIVEN = ("speed", "stride_time", "stride_length")
STEPS = 12
QUIET = 0.5  # [s] before and after the walk
SAMPLES = 2560  # of every simulated walk, so that one program serves all sampling rates
PLACEMENTS = ("pelvis", "thigh_right", "thigh_left", "shank_right", "shank_left", "foot_right", "foot_left")
VARIABILITY = 0.015  # of step time and length; without it all contacts fall on the same place between two samples
MARKER = 0.03  # [m] of heel and toe markers above the sole


class Set(NamedTuple):
    """How a data set was recorded: its name and condition, its sampling rate [Hz], the range of the shoes' [m/s²]."""

    name: str
    condition: str | None
    rate_hz: float
    acc_range: float = np.inf
    resting: bool = False

    @property
    def label(self) -> str:
        """What rows and tables call it."""
        return self.name if self.condition is None else f"{self.name}_{self.condition.lower().replace('+', 'p')}"


SETS = (
    Set("neura_sparse", None, 100.0, resting=True),
    Set("gaitmap_example", None, 204.8, 16.0 * GRAVITY),
    Set("tripod", "PWS", 128.0),
    Set("tripod", "PWS+20", 128.0),
    Set("walking5m", "Young", 100.0),
    Set("walking5m", "Elderly", 100.0),
)


class Walked(NamedTuple):
    """What `figures` needs of one walk, or of many with a leading axis.

    Attributes:
        gyr: placement → (T, 3) [rad/s].
        acc: placement → (T, 3) [m/s²].
        pelvis: (T, 3) middle of the hips [m].
        slowest: (2, T) the slower of heel and toe marker of the right and the left foot [m/s].
        hip: (2, T) thigh from the vertical [rad].
        knee: (2, T) [rad].
        contact: (K,) [s] when footholds are taken, from the two at the start on.
        stance: [s] how long a foot is on the ground, evenly walking.
        right_first: 1 if the right foot takes the first step.
        width: (K,) of strides [m].
    """

    gyr: dict[str, Any]
    acc: dict[str, Any]
    pelvis: Any
    slowest: Any
    hip: Any
    knee: Any
    contact: Any
    stance: Any
    right_first: Any
    width: Any


def _walked(key: Any, person: Person, time: Any, errors: ImuErrors) -> Walked:
    read, true = walk(key, person, straight(100.0), time, errors, capacity=STEPS, placements=PLACEMENTS)
    body, gait = person
    slowest = []
    for side in SIDES:
        rate = getattr(true.motion.rate.segments, f"foot_{side}")
        speeds = []
        for ahead in (-body.heel_length, body.ball_length):
            v = in_world(rate, Vector(ahead, 0.0, MARKER - body.ankle_height))
            speeds.append(jnp.sqrt(v.x * v.x + v.y * v.y + v.z * v.z + 1e-12))
        slowest.append(jnp.minimum(*speeds))
    legs = [getattr(true.estimate.legs, side) for side in SIDES]
    return Walked(
        {name: imu.gyr for name, imu in read.items()}, {name: imu.acc for name, imu in read.items()},
        jnp.stack(true.motion.pose.segments.pelvis.origin, axis=1), jnp.stack(slowest),
        jnp.stack([leg.hip_angle for leg in legs]), jnp.stack([leg.knee_angle for leg in legs]), true.plan.contact,
        jnp.asarray(gait.stance_fraction) * gait.stride_time, jnp.asarray(gait.right_first), true.strides.width,
    )  # fmt: skip


_many = jax.jit(jax.vmap(_walked, in_axes=(None, 0, None, None)))


def stacked(people: list[Person]) -> Person:
    """Many people as one `Person` of arrays (n,)."""
    return jax.tree.map(lambda *values: jnp.asarray(np.array(values, float)), *people)


def walks_of(people: list[Person], rate_hz: float, acc_range: float = np.inf, seed: int = 0) -> list[Walked]:
    """Everyone walks `STEPS` steps straight ahead, sampled at a rate [Hz]; in NumPy."""
    key = jax.random.key(seed)  # the same for all, so that people differ by what they are only
    time = jnp.asarray(np.arange(SAMPLES) / rate_hz)
    errors = IDEAL._replace(acc_range=acc_range)
    done = jax.tree.map(np.asarray, _many(key, stacked(people), time, jax.tree.map(float, errors)))
    return [jax.tree.map(lambda a, i=i: a[i], done) for i in range(len(people))]


def at_speed(gait: Gait, stride_time: float, stride_length: float) -> Gait:
    """The same manner at another stride, for a walk of `STEPS` steps that are not all alike."""
    return gait._replace(
        stride_time=stride_time, stride_length=stride_length, steps=float(STEPS), quiet_before=QUIET,
        quiet_after=QUIET, time_variability=VARIABILITY, length_variability=VARIABILITY,
    )  # fmt: skip


def window(one: Walked, rate_hz: float) -> tuple[int, int]:
    """Samples of even walking: without the first two steps and the last two."""
    first, last = one.contact[FIRST + 2], one.contact[FIRST + STEPS - 1]
    return round(float(first) * rate_hz), min(round(float(last) * rate_hz), SAMPLES)


def simulated_figures(one: Walked, given: Set) -> Figures:
    """Figures of both legs of a simulated walk, as `_real_gait` has those of the set."""
    part, parts = window(one, given.rate_hz), []
    time = np.arange(SAMPLES) / given.rate_hz
    distance = one.pelvis[:, 0] - one.pelvis[0, 0]
    for number, side in enumerate(SIDES):
        sensors = {s: (one.gyr[f"{s}_{side}"], one.acc[f"{s}_{side}"]) for s in ("shank", "thigh", "foot")}
        sensors["pelvis"] = (one.gyr["pelvis"], one.acc["pelvis"])
        if given.name == "gaitmap_example":
            sensors = {"foot": sensors["foot"]}
        contact = one.slowest[number] < RESTING if given.resting else bears(one, number, time)
        known = Truth(distance, contact, one.hip[number], one.knee[number], one.pelvis[:, 2])
        parts.append(figures(sensors, given.rate_hz, [part], known))
    return pool(parts)._replace(stride_width=one.width[4 : STEPS - 1])


def bears(one: Walked, side: int, time: np.ndarray) -> np.ndarray:
    """(T,) bool, whether a foot (0 right, 1 left) is on the ground, while walking evenly."""
    odd = (one.right_first > 0.5) == (side == 0)  # footholds 1, 3 … are those of the foot that takes the first step
    own = one.contact[FIRST + (1 if odd else 2) : FIRST + STEPS + 1 : 2]
    since = time - own[np.clip(np.searchsorted(own, time, side="right") - 1, 0, None)]
    return (since >= 0.0) & (since < one.stance)


def medians(strides: Figures) -> dict[str, float]:
    """Median of every figure that there is."""
    return {name: float(np.median(values)) for name, values in strides._asdict().items() if len(values)}


def comparable(real: dict[str, Spread]) -> dict[str, Spread]:
    """Figures of a real set that a simulated one can be held against: more than one value, and not given to it."""
    return {key: one for key, one in real.items() if one.n > 1 and key not in GIVEN and not key.endswith("_p99")}
