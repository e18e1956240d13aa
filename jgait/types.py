"""The records that all parts of jgait exchange (sensors, recordings, strides, estimates), and the array types.

Inside the library all units are SI: seconds, metres, radians, rad/s, m/s². The gyroscope signal is `gyr`, the
accelerometer signal `acc`; an accelerometer at rest reads +9.81 along the axis that points up. A simulator, motion
capture and an estimator all return an `Estimate`; an error measure compares two estimates.
"""

import unicodedata
from collections.abc import Hashable, Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from jaxtyping import Array, Bool, Float, Int

from jgait.notes import Note, printable, record

AnyArray = Array | np.ndarray
"""A JAX array, or a NumPy array on the host: `Float[AnyArray, "time 3"]`."""

Scalar = Float[AnyArray, ""] | float | np.floating
"""One number: a Python float, or an array without axes."""

Integer = Int[AnyArray, ""] | int | np.integer
"""One whole number: a Python int, or an array without axes."""

if TYPE_CHECKING:  # array, tracer or Python number: the caller decides, so the shapes are checked when the tests run
    type Values = Any
    type Flags = Any
    type Counts = Any
else:
    Values = Float[AnyArray, "..."] | float | np.floating
    Flags = Bool[AnyArray, "..."] | bool | np.bool_
    Counts = Int[AnyArray, "..."] | int | np.integer
"""`Values`: numbers of any shape, for elementwise functions; `Flags`: truth values; `Counts`: whole numbers."""

type Maybe[T] = T | Any
"""A field that can be None; the record's docstring states when. Code must not read the field where it is None."""

type Measures = dict[str, Any]
"""Measures of a person: name, such as "thigh_length" [m] → a number, or (right, left)."""

# Fields of the records below. Records of several recordings are stacked along leading axes, `*batch`.
Series = Float[AnyArray, "*batch time"]
Series3 = Float[AnyArray, "*batch time 3"]
Mask = Bool[AnyArray, "*batch time"]
Rows = Float[AnyArray, "*batch row"]

SIDES = ("right", "left")

PLACEMENTS = (
    "head", "sternum", "lower_back", "pelvis", "waist",
    *(f"{segment}_{side}" for segment in ("wrist", "thigh", "shank", "ankle", "foot") for side in SIDES),
)  # fmt: skip
"""Places of a sensor. `shank` is the middle of the shank, `ankle` its lower end just above the malleoli."""


@record
class Imu(NamedTuple):
    """One inertial sensor on its own clock."""

    time: Series  #: (T,) [s], strictly increasing.
    gyr: Series3  #: (T, 3) [rad/s] angular rate in the sensor's axes; finite everywhere, 0 where the mask is False.
    acc: Maybe[Series3]  #: (T, 3) [m/s²] specific force in the sensor's axes, or None; finite everywhere.
    mask: Mask  #: (T,) bool; False where the sample was lost or cannot be trusted.


@record
class RangeReadings(NamedTuple):
    """Distances between two places, as a range sensor measures them."""

    time: Series  #: (T,) [s], on the clock of the inertial sensors.
    distance: Series  #: (T,) [m]; 0 where there is no reading.
    mask: Mask  #: (T,) bool; True where a distance was read.


class Recording(NamedTuple):
    """The sensor signals of one person during one walk."""

    sensors: dict[str, Imu]  #: placement (see `PLACEMENTS`) → `Imu`.
    sampling_rate_hz: float  #: nominal rate of the sensors [Hz].
    name: str = "recording"  #: the name of the recording in tables and figures.
    subject: str = "subject"  #: identifier of the person; all recordings of a subject are in the same part of a split.
    #: facts that the reader of the file noticed or changed (unit conversions, dropped samples).
    notes: tuple[Note, ...] = ()
    #: distance from the inner side of the left ankle to the right leg, or None.
    feet_range: RangeReadings | None = None
    #: placement → facts about its sensor that the reader computed, a `jgait.quality.SensorQuality`; also of sensors
    #: that the reader left out.
    quality: dict[str, Any] = {}  # noqa: RUF012
    #: stretches in which the person moves without walking (begin, end) [s]. The sensors have standing there, but for
    #: those of an estimator whose path goes on. None: not judged, the sensors are as read.
    moves: tuple[tuple[float, float], ...] | None = None

    def __repr__(self) -> str:
        parts = [f"{len(imu.time)} samples" for imu in list(self.sensors.values())[:1]]
        parts += [f"{self.sampling_rate_hz:g} Hz", "sensors " + ", ".join(self.sensors), f"{len(self.notes)} notes"]
        return f"Recording({self.name!r}: {'; '.join(parts)})"


def people(labels: Iterable[Hashable]) -> list[str]:
    """The name of each label's person: the person's first label as text, without spaces at the ends.

    Two labels name one person if they are equal as text, apart from capitals, the number of spaces, and the way in
    which letters with accents are encoded.

    Raises:
        ValueError: if a label is missing (None or NaN).
    """
    listed = list(labels)
    missing = sum(not isinstance(label, str) and str(label) in ("None", "nan", "<NA>", "NaT") for label in listed)
    if missing:
        raise ValueError(f"every row needs a subject; {missing} of {len(listed)} have none")
    texts = [str(label).strip() for label in listed]
    first: dict[str, str] = {}
    for text in texts:
        first.setdefault(_key(text), text)
    return [first[_key(text)] for text in texts]


def _key(text: str) -> str:
    return unicodedata.normalize("NFC", " ".join(text.split())).casefold()


def numbered_people(labels: Iterable[Hashable]) -> tuple[tuple[str, ...], np.ndarray]:
    """The names of the people in order of appearance, and the number of each label's person; see `people`."""
    names = people(labels)
    number = {name: number for number, name in enumerate(dict.fromkeys(names))}
    return tuple(number), np.asarray([number[name] for name in names], np.int32)


@record
class LegTrajectory(NamedTuple):
    """One leg in its sagittal plane, seen with forward to the right; the hip is the origin."""

    hip_angle: Series  #: (T,) [rad] thigh from the downward vertical, flexion (knee forward) positive.
    knee_angle: Series  #: (T,) [rad] shank relative to thigh, flexion positive, 0 when straight.
    x: Series  #: (T,) [m] ankle relative to hip, forward.
    y: Series  #: (T,) [m] ankle relative to hip, up (about minus the leg length when standing).


@record
class Legs(NamedTuple):
    """Both legs, each a `LegTrajectory`, or None where the leg was not measured."""

    right: LegTrajectory | None
    left: LegTrajectory | None


@record
class FootTrajectory(NamedTuple):
    """The trajectory of one foot's sensor; for standard deviations, `orientation` is (T, 3), a rotation vector."""

    position: Series3  #: (T, 3) [m] in the world, z up.
    velocity: Maybe[Series3]  #: (T, 3) [m/s].
    #: (T, 4) unit quaternion q_ws, w first: rotates vectors from the sensor frame to the world frame.
    orientation: Maybe[Float[AnyArray, "*batch time 4"]]


@record
class Feet(NamedTuple):
    """Both feet, each a `FootTrajectory`, or None where the foot was not measured."""

    right: FootTrajectory | None
    left: FootTrajectory | None


@record
class Strides(NamedTuple):
    """Strides of both feet, each from one initial contact of a foot to its next initial contact; every field is (n,).

    As standard deviations: the same fields, None or 0 where none is given; `side` and `valid` are repeated.

    A field after `valid` is None where the source does not give it; NaN in `width` and `step_length` means that
    the other foot had no foothold between the two footholds, or was not measured.
    """

    side: Int[AnyArray, "*batch row"]  #: 0 right, 1 left; the order of `SIDES`.
    start: Maybe[Rows]  #: initial contact at which the stride begins [s]; the toe-off for a first stride from standing.
    final_contact: Maybe[Rows]  #: time at which the toes leave the ground [s].
    end: Maybe[Rows]  #: initial contact at which the stride ends [s].
    length: Rows  #: horizontal distance between the two footholds [m].
    width: Rows  #: distance from the line through the two footholds to the other foot's foothold between them [m].
    height: Rows  #: rise from one foothold to the next [m].
    valid: Bool[AnyArray, "*batch row"]  #: bool; False for a padding row.
    standing: Maybe[Rows] = None  #: time at which the foot moves least on its first foothold [s].
    standing_end: Maybe[Rows] = None  #: time at which the foot moves least on its second foothold [s].
    #: length over the time between the contacts; for a first stride `standing` to `standing_end` [m/s].
    speed: Maybe[Rows] = None
    turn: Maybe[Rows] = None  #: change of the foot's heading, left positive [rad].
    lift: Maybe[Rows] = None  #: largest height of the foot's sensor above the higher of its two footholds [m].
    contact_angle: Maybe[Rows] = None  #: pitch of the foot at `end`, relative to standing, toes up positive [rad].
    #: pitch of the foot at the final contact, toes up positive, so that the angle is negative [rad].
    push_off_angle: Maybe[Rows] = None
    #: distance from the first foothold to the other foot's foothold between them, along the stride [m].
    step_length: Maybe[Rows] = None


@record
class Estimate(NamedTuple):
    """The result of an estimator, a simulator or motion capture for one recording."""

    time: Series  #: (T,) [s].
    legs: Legs  #: joint angles and foot position.
    stddev: Legs | None  #: standard deviations of `legs` in the same type, or None where the source gives none.
    distance: Maybe[Series]  #: (T,) [m] distance walked since the start, or None.
    valid: Mask  #: (T,) bool; False where the values are not usable (padding, no data yet).
    diagnostics: dict[str, Any]  #: name → scalar, array or other measure of the quality of the result.
    strides: Maybe[Strides] = None  #: `Strides`, or None where the source gives none.
    feet: Feet | None = None  #: trajectories of the feet's sensors, `Feet`, or None.
    feet_stddev: Feet | None = None  #: standard deviations of `feet` in the same type, or None.
    strides_stddev: Maybe[Strides] = None  #: standard deviations of `strides` in the same type, or None.


@record
class Walk(NamedTuple):
    """One recorded walk."""

    recording: Recording  #: the sensor signals.
    reference: Estimate | None  #: an independent measurement of the walk as an `Estimate`, or None.
    info: dict[str, Any]  #: further information; the module of each data set lists the keys.


class RecordingError(ValueError):
    """A recording cannot be used; the message names the expected and the actual content.

    Attributes:
        template: the message, with `{argument}` for the argument of a reader that would prevent the error.
        argument: the argument, such as "gyr_unit"; empty: no argument prevents the error.
        value: value that the argument should have; empty: only the caller can know the value.
        LONGEST: [characters] longest message; of a longer one the middle is left out.
    """

    LONGEST = 600

    def __init__(self, template: str, *, argument: str = "", value: str | dict[str, str] = "") -> None:
        self.template, self.argument, self.value = template, argument, value
        super().__init__(self.with_argument(f"{argument}={value!r}" if value else argument))

    def with_argument(self, name: str) -> str:
        """The message with another name of the argument, such as an option of a command; at most `LONGEST`."""
        text = self.template.replace("{argument}", name) if self.argument else self.template
        return printable(text, self.LONGEST)


COMPILED_FAILED = (
    "; a compiled program failed. If the next run fails as well, remove the programs that are kept between runs by "
    "`jgait cache --clear`"
)
"""What `reason_of` adds to the errors of compiled programs."""


def reason_of(error: BaseException) -> str:
    """The reason for an error in one line: its message; unless it is an error of data or files, its class as well.

    Errors of a compiled program, unless it lacked memory, point to the command that removes the kept programs.
    """
    text = str(error) if isinstance(error, ValueError | OSError) else f"{type(error).__name__}: {error}"
    if isinstance(error, OSError) and error.filename is not None:  # without the number that the system gives it
        text = f"{error.filename}: {error.strerror}"
    compiled = type(error).__name__ in ("JaxRuntimeError", "XlaRuntimeError") and "RESOURCE_EXHAUSTED" not in text
    return " ".join(text.split()) + (COMPILED_FAILED if compiled else "")


def check_kind(value: object, kind: type | tuple[type, ...], what: str) -> None:
    """Raise TypeError if an argument is not of the types `kind`; `what` is the begin of the message: "p must be …"."""
    if not isinstance(value, kind):
        shown = f" {printable(repr(value), 60)}" if isinstance(value, str | int | float) else ""
        raise TypeError(f"{what}; got {type(value).__name__}{shown}")


def check_number(value: npt.ArrayLike, what: str) -> None:
    """As `check_kind`, for one number: of Python, or an array without axes."""
    check_kind(value, (int, float, np.number, np.ndarray, Array), what)
    if np.ndim(value) != 0:
        raise TypeError(f"{what}; got an array of shape {np.shape(value)}")


def check_key(key: object) -> None:
    """Raise TypeError if an argument is no random key of JAX."""
    import jax
    import jax.numpy as jnp

    what = "key must be a random key of JAX, such as jax.random.key(0)"
    if not isinstance(key, jax.Array | np.ndarray):
        check_kind(key, (), what)
    elif not (jnp.issubdtype(key.dtype, jax.dtypes.prng_key) or (key.shape == (2,) and key.dtype == np.uint32)):
        raise TypeError(f"{what}; got an array of {key.dtype} with shape {key.shape}")


def check_recording(value: object) -> None:
    """Raise TypeError if an argument is no recording."""
    check_kind(value, Recording, "recording must be a jgait.types.Recording, as jgait.io.read(path) returns it")


def leg_of(legs: Legs, side: str) -> LegTrajectory:
    """The trajectory of one side.

    Raises:
        ValueError: if the side is not 'right' or 'left', or was not measured.
    """
    if side not in SIDES:
        raise ValueError(f"side must be 'right' or 'left'; got {side!r}")
    leg = legs.right if side == "right" else legs.left
    if leg is None:
        raise ValueError(f"the {side} leg was not measured")
    return leg


def as_float(values: npt.ArrayLike) -> Float[np.ndarray, "..."]:
    """A float64 NumPy array of array-like values: the type of the signals of recordings on the host."""
    return np.asarray(values, dtype=np.float64)
