"""Simulated walks as the sets of `real` are: the same speed, sampling rate, sensors and rules, the same figures.

Stance is computed as by each set's reader: on `neura_sparse` by heel and toe slower than `RESTING`, else by the
simulator's own contacts. Sensors are perfect but for their range, and worn where those of the set are. Only the
stride's time and length are taken from a set, so what they fix (`GIVEN`) is no test of the simulator.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.sets import datasets
from experiments.simulator import real
from experiments.simulator.gait import (
    Figures,
    Truth,
    figures,
    find_strides,
    pool,
    sagittal_rates,
)
from experiments.simulator.real import RESTING, Spread
from jgait.geometry.segments import Motion, in_world
from jgait.geometry.vectors import GRAVITY, Vector
from jgait.plot.style import blank
from jgait.simulate import Body, Gait, Person, gait, straight
from jgait.simulate.footsteps import FIRST
from jgait.simulate.sensors import IDEAL, ImuErrors
from jgait.simulate.walker import plan, separated
from jgait.simulate.worn import Sensors, named, sensors_at, walked
from jgait.types import SIDES, leg_of

GIVEN = ("speed", "stride_time", "stride_length")
STEPS = 12
QUIET = 0.5  # [s] before and after the walk
SAMPLES = 2560  # of every simulated walk, so that one program serves all sampling rates
PLACEMENTS = ("pelvis", "thigh_right", "thigh_left", "shank_right", "shank_left", "foot_right", "foot_left")
VARIABILITY = 0.015  # of step time and length; without it all contacts fall on the same place between two samples
RULES = Gait()
MARKER = 0.03  # [m] of heel and toe markers above the sole


class Set(NamedTuple):
    """How a data set was recorded: its name and condition, its sampling rate [Hz], the range of the shoes' [m/s²], and
    where sensors are worn on thigh and shank: ahead of the bone [m], and how far down [lengths of the segment], and on
    the foot: ahead of the ankle and above it [m], by `experiments.people.mounts`."""

    name: str
    condition: str | None
    rate_hz: float
    acc_range: float = np.inf
    resting: bool = False
    thigh: tuple[float, float] = (0.07, 0.5)
    shank: tuple[float, float] = (0.04, 0.5)
    foot: tuple[float, float] = (0.055, 0.0)

    @property
    def label(self) -> str:
        """What rows and tables call it."""
        return self.name if self.condition is None else f"{self.name}_{self.condition.lower().replace('+', 'p')}"


SETS = (
    Set("neura_sparse", None, 100.0, resting=True, thigh=(0.04, 0.64), shank=(0.04, 0.44), foot=(0.07, -0.01)),
    Set("gaitmap_example", None, 204.8, 16.0 * GRAVITY),
    Set("tripod", "PWS", 128.0, shank=(0.04, 0.75)),
    Set("tripod", "PWS+20", 128.0, shank=(0.04, 0.75)),
    Set("walking5m", "Young", 100.0, thigh=(-0.01, 0.86), shank=(-0.015, 0.43), foot=(0.0, -0.095)),
    Set("walking5m", "Elderly", 100.0, thigh=(-0.01, 0.86), shank=(-0.015, 0.43), foot=(0.0, -0.095)),
)
"""Sensors on shoes of `walking5m` come out below the sole of a bare foot, perhaps since shoes lift the ankle;
`experiments.people.movement` fits better with this place than with one on the sole."""


WORN_AT = ("thigh", "shank", "foot")


def sensors_of(body: Body, placements: Sequence[str], places: Any) -> Sensors:
    """Sensors at placements, on thigh, shank and foot at places (3, 2), see `Set`."""
    sensors = sensors_at(body, placements)
    points = list(jnp.asarray(sensors.point))
    for i, name in enumerate(placements):
        segment = name.partition("_")[0]
        if segment in WORN_AT:
            ahead, along = places[WORN_AT.index(segment)]
            down = {"thigh": -body.thigh_length, "shank": -body.shank_length, "foot": 1.0}[segment]
            points[i] = jnp.stack([ahead, jnp.zeros_like(ahead), along * down])
    return sensors._replace(point=jnp.stack(points))


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


def _walked(key: Any, person: Person, time: Any, errors: ImuErrors, places: Any) -> Walked:
    body, own = person
    walks, reads = jax.random.split(key)
    laid = plan(walks, person, straight(100.0), STEPS)
    imus, moving, known = walked(reads, person, laid, time, errors, sensors_of(body, PLACEMENTS, places))
    read, motion = named(imus, time, PLACEMENTS), Motion(*map(separated, moving))
    slowest = []
    for side in SIDES:
        rate = getattr(motion.rate, f"foot_{side}")
        speeds = []
        for ahead in (-body.heel_length, body.ball_length):
            v = in_world(rate, Vector(ahead, 0.0, MARKER - body.ankle_height))
            speeds.append(jnp.sqrt(v.x * v.x + v.y * v.y + v.z * v.z + 1e-12))
        slowest.append(jnp.minimum(*speeds))
    legs = [leg_of(known.legs, side) for side in SIDES]
    return Walked(
        {name: imu.gyr for name, imu in read.items()}, {name: imu.acc for name, imu in read.items()},
        jnp.stack(motion.pose.pelvis.origin, axis=1), jnp.stack(slowest),
        jnp.stack([leg.hip_angle for leg in legs]), jnp.stack([leg.knee_angle for leg in legs]), laid.contact,
        jnp.asarray(own.stance_fraction) * own.stride_time, jnp.asarray(own.right_first), known.strides.width,
    )  # fmt: skip


_many = jax.jit(jax.vmap(_walked, in_axes=(None, 0, None, None, None)))


def stacked(people: list[Person]) -> Person:
    """Many people as one `Person` of arrays (n,)."""
    return jax.tree.map(lambda *values: jnp.asarray(np.array(values, float)), *people)


def walks_of(people: list[Person], given: Set, seed: int = 0) -> list[Walked]:
    """Everyone walks `STEPS` steps straight ahead, with the sensors of a set; in NumPy."""
    key = jax.random.key(seed)  # the same for all, so that people differ by what they are only
    time = jnp.asarray(np.arange(SAMPLES) / given.rate_hz)
    errors, places = IDEAL._replace(acc_range=given.acc_range), jnp.asarray([given.thigh, given.shank, given.foot])
    done = jax.tree.map(np.asarray, _many(key, stacked(people), time, jax.tree.map(float, errors), places))
    return [jax.tree.map(lambda a, i=i: a[i], done) for i in range(len(people))]


def person_at(stride_time: float, stride_length: float, base: Gait = RULES, **others: float) -> Person:
    """The usual person at a stride, for a walk of `STEPS` steps that are not all alike."""
    usual = gait(stride_length=stride_length, cadence=120.0 / stride_time, usual=base)
    walks = usual._replace(
        steps=float(STEPS), quiet_before=QUIET, quiet_after=QUIET, time_variability=VARIABILITY,
        length_variability=VARIABILITY,
    )  # fmt: skip
    return Person(gait=walks._replace(**others))


def window(one: Walked, rate_hz: float, whole: bool = False) -> tuple[int, int]:
    """Samples of even walking: without the first two steps and the last two; or of the whole walk."""
    first, last = (one.contact[FIRST + step] for step in ((0, STEPS + 1) if whole else (2, STEPS - 1)))
    return round(float(first) * rate_hz), min(round(float(last) * rate_hz), SAMPLES)


def simulated_figures(one: Walked, given: Set) -> Figures:
    """Figures of both legs of a simulated walk, as `real` has those of the set."""
    part = [window(one, given.rate_hz)]
    legs = [leg_of_simulated(one, given, number) for number in range(2)]
    parts = [figures(sensors, given.rate_hz, part, known) for sensors, known in legs]
    return pool(parts)._replace(stride_width=one.width[4 : STEPS - 1])


def bears(one: Walked, side: int, time: np.ndarray) -> np.ndarray:
    """(T,) bool, whether a foot (0 right, 1 left) is on the ground, while walking evenly."""
    odd = (one.right_first > 0.5) == (side == 0)  # footholds 1, 3 … are those of the foot that takes the first step
    own = one.contact[FIRST + (1 if odd else 2) : FIRST + STEPS + 1 : 2]
    since = time - own[np.clip(np.searchsorted(own, time, side="right") - 1, 0, None)]
    return (since >= 0.0) & (since < one.stance)


CURVES = {
    "shank": "shank rate [rad/s]", "thigh": "thigh rate [rad/s]", "foot": "foot rate [rad/s]",
    "shank_acc": "shank |acc| [m/s²]", "thigh_acc": "thigh |acc| [m/s²]", "foot_acc": "foot |acc| [m/s²]",
    "hip": "hip flexion [°]", "knee": "knee flexion [°]", "height": "pelvis height [cm]",
}  # fmt: skip


def curves(
    sensors: dict[str, tuple[Any, Any]], rate_hz: float, windows: Any, known: Truth, *, trim: int = 0, good: Any = None
) -> dict[str, np.ndarray]:
    """What a leg does over each stride, from the middle of one swing to the next: name → (n, 101).

    Arguments as those of `gait.figures`; height is from its mean over the stride.
    """
    lead, rates = sagittal_rates(sensors, rate_hz, windows)
    strides = find_strides(rates[lead], rate_hz, windows, trim, good)
    series = dict(rates)
    series |= {f"{s}_acc": np.linalg.norm(np.asarray(sensors[s][1]), axis=1) for s in rates}
    series |= {name: np.degrees(v) for name, v in (("hip", known.hip), ("knee", known.knee)) if v is not None}
    if known.height is not None:
        series["height"] = 100.0 * np.asarray(known.height)
    cut = {name: _resampled(values, strides) for name, values in series.items()}
    if "height" in cut and len(cut["height"]):
        cut["height"] = cut["height"] - cut["height"].mean(axis=1, keepdims=True)
    return cut


def _resampled(series: np.ndarray, strides: Any) -> np.ndarray:
    """(n, 101) of each stride."""
    index = np.arange(len(series))
    rows = [np.interp(np.linspace(a, b, 101), index, series) for a, b in zip(strides.start, strides.end, strict=True)]
    return np.array(rows).reshape(-1, 101)


def leg_of_simulated(one: Walked, given: Set, number: int) -> tuple[dict[str, tuple[Any, Any]], Truth]:
    """The sensors that a set has on one leg (0 right, 1 left), and what else is known."""
    side, time = SIDES[number], np.arange(SAMPLES) / given.rate_hz
    worn = {
        "gaitmap_example": ("foot",), "tripod": ("shank", "foot", "pelvis"), "walking5m": ("shank", "thigh", "foot"),
    }.get(given.name, ("shank", "thigh", "foot", "pelvis"))  # fmt: skip
    places = {s: s if s == "pelvis" else f"{s}_{side}" for s in worn}
    contact = one.slowest[number] < RESTING if given.resting else bears(one, number, time)
    distance = one.pelvis[:, 0] - one.pelvis[0, 0]
    known = Truth(distance, contact, one.hip[number], one.knee[number], one.pelvis[:, 2])
    return {s: (one.gyr[place], one.acc[place]) for s, place in places.items()}, known


def simulated_curves(one: Walked, given: Set) -> dict[str, np.ndarray]:
    """As `curves`, of both legs of a simulated walk."""
    part = [window(one, given.rate_hz)]
    legs = [leg_of_simulated(one, given, number) for number in range(2)]
    parts = [(own, known) for sensors, known in legs for own in together(sensors, given)]
    return pooled([curves(own, given.rate_hz, part, known) for own, known in parts])


def together(sensors: dict[str, tuple[Any, Any]], given: Set) -> list[dict[str, tuple[Any, Any]]]:
    """The sensors of a leg that are cut by the same swings: `tripod` has feet up to 0.14 s off the shanks' clock."""
    if given.name != "tripod" or "foot" not in sensors:
        return [sensors]
    rest = {name: one for name, one in sensors.items() if name != "foot"}
    return [{"foot": sensors["foot"]}, *([rest] if "shank" in rest else [])]


def real_curves(given: Set) -> dict[str, np.ndarray]:
    """As `curves`, of all strides of a real set; {} of one whose curves are not drawn."""
    parts = []
    for walk_ in datasets.load(given.name, names_of(given)):
        if walk_.reference is None or given.name == "gaitmap_example":
            continue
        rate_hz, trim = walk_.recording.sampling_rate_hz, 0
        if given.name == "neura_sparse":
            named = [w for name, w in walk_.info["windows"].items() if name.startswith("straight")]
            windows = [p for w in named for p in real._brisk(walk_.reference.distance, w, rate_hz)]
        elif given.name == "tripod":
            windows = [walk_.info["windows"]["steady"]]
        else:
            windows, trim = [walk_.info["windows"]["whole"]], 1
        for side in SIDES if windows else ():
            crossed = {one for pair in walk_.info.get("misplaced", ()) for one in pair}
            if f"shank_{side}" not in walk_.recording.sensors or f"shank_{side}" in crossed:
                continue
            sensors, good = real._leg(walk_, side)
            known = Truth()
            if given.name == "neura_sparse":
                leg, centres = leg_of(walk_.reference.legs, side), walk_.info["joint_centres"]
                height = (centres["right"]["hip"][:, 2] + centres["left"]["hip"][:, 2]) / 2
                known = Truth(None, None, leg.hip_angle, leg.knee_angle, height)
            for own in together(sensors, given):
                parts.append(curves(own, rate_hz, windows, known, trim=trim, good=good))
    return pooled(parts)


def names_of(given: Set) -> list[str]:
    """Names of a set's recordings."""
    every = datasets.names(given.name)
    return [one for one in every if given.condition is None or given.condition in one.split("/")]


def pooled(parts: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """The strides of several legs or walks together."""
    return {
        name: np.concatenate([part[name] for part in parts if name in part])
        for name in CURVES
        if any(name in part and len(part[name]) for part in parts)
    }


def overlay(given: Set, real: dict[str, np.ndarray], simulated: dict[str, np.ndarray]) -> Any:
    """A figure of simulated strides on real ones: medians, and from the 5th to the 95th percentile."""
    shown = [name for name in CURVES if name in real and name in simulated]
    rows = math.ceil(len(shown) / 3)
    figure, axes = blank(rows, 3, 9.6, 2.2 * rows + 0.7)
    share = np.arange(101)
    for axis, name in zip(axes.flat, shown, strict=False):
        low, middle, high = np.percentile(real[name], [5, 50, 95], axis=0)
        axis.fill_between(share, low, high, color="0.82", linewidth=0, label="real, 5 to 95 %")
        axis.plot(share, middle, color="0.45", linewidth=1.6, linestyle=(0, (4, 2)), label="real, median")
        low, middle, high = np.percentile(simulated[name], [5, 50, 95], axis=0)
        axis.fill_between(share, low, high, color="#c0392b", alpha=0.25, linewidth=0)
        axis.plot(share, middle, color="#c0392b", linewidth=1.4, label="simulated")
        axis.set_title(CURVES[name], fontsize=9)
        axis.grid(alpha=0.3)
    for axis in axes.flat[len(shown) :]:
        axis.set_visible(False)
    for axis in axes[-1]:
        axis.set_xlabel("middle of one swing to the next [%]", fontsize=8)
    axes[0, 0].legend(fontsize=7, loc="upper center", framealpha=0.9)
    figure.suptitle(given.label.replace("_", " "), fontsize=11)
    return figure


def medians(strides: Figures) -> dict[str, float]:
    """Median of every figure that there is."""
    return {name: float(np.median(values)) for name, values in strides._asdict().items() if len(values)}


def comparable(real: dict[str, Spread]) -> dict[str, Spread]:
    """Figures of a real set that a simulated one can be held against: more than one value, and not given to it."""
    return {key: one for key, one in real.items() if one.n > 1 and key not in GIVEN and not key.endswith("_p99")}
