"""The walker whose virtual sensors are closest to a recording, so that other sensors can be put on this person.

Compared is the mean stride of one foot, from contact to contact: rates and specific forces of all sensors, in the first
`HARMONICS` harmonics of the stride; above them strides of one person differ in phase, and a mean blurs them. Sensors
may sit in any orientation: the rotation that fits best is computed for each sensor at every step (Kabsch). What is
fitted is most probable:

    Σ over sensors COUNT (unexplained / EXPECTED)² + Σ z²

with z the parameters less their usual values at this stride, in standard deviations between people.
"""

from collections.abc import Collection, Mapping
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from jgait.estimators.combined import Analysis, analyse
from jgait.estimators.combined.strides import regular
from jgait.estimators.programs import compiled
from jgait.geometry.vectors import Vector
from jgait.notes import Kind, Note
from jgait.simulate.person import RECORDED, Body, Gait, Person, evenly
from jgait.simulate.population import PELVIS_SPREAD, able, gait, manner
from jgait.simulate.routes import straight
from jgait.simulate.shapes import STYLES
from jgait.simulate.walker import moved, planned, ticks
from jgait.simulate.worn import SEVEN, Sensors, ideal_readings, sensors_at
from jgait.types import SIDES, Recording, Values, as_float

SPREAD: dict[str, float] = {
    "thigh_length": 0.05, "shank_length": 0.05, "stance_fraction": 0.03, "toe_up": 0.25,
    "heel_up": 0.1, "foot_flat": 0.25, "heel_off": 0.12, "swing_lift": 0.5, "landing_speed": 0.4, "hip_ahead": 0.6,
    "knee_stance": 0.2, "soft_tissue": 0.3, **PELVIS_SPREAD,
}  # fmt: skip
"""[1] Standard deviation between people of the logarithm of each parameter, at one stride.

Chosen, but those of the pelvis: about as wide as `experiments.people.movement` lets people differ at one stride."""

SIZES = ("stride_length", *SPREAD)
"""What is scaled; of the stride's length by the error that is stated for the recording."""
FREE = (*SIZES, *STYLES)
POINTS, HARMONICS, MOST = 100, 8, len(SEVEN)
"""[1] Points of the mean stride, harmonics that count, sensors that take part."""
LOW = np.fft.irfft(np.fft.rfft(np.eye(POINTS), axis=0)[: HARMONICS + 1], n=POINTS, axis=0)
"""(POINTS, POINTS) takes the other harmonics off a stride."""
COUNT, EXPECTED = 2.0 * HARMONICS, (0.3, 0.5)
"""[1] Independent points of a signal; unexplained shares of rates and of specific forces that weigh as a standard
deviation. Chosen, twice as large for forces, of which the usual walker explains less."""
NUMBERS = len(FREE) + 3 * MOST + 1
ROUNDS, ENOUGH, MOVE = 20, 1e-3, 1e-3
"""Most rounds of the fit, the relative gain at which it ends, and the move for its slopes [standard deviations]."""
MOST_STEPS = 2000
"""[1] Steps of the longest walk that is simulated."""
PLACE, PHASE = 0.03, 0.04
"""[m] [1] Standard deviations of the place of a sensor on its segment, and of the contacts, in shares of the stride."""
BEGINS = np.linspace(-2.0, 2.0, 17)
"""[standard deviations] Contacts with which the fit may begin; the best of them is taken."""

POOR = Kind(
    "walker_fits_poorly", "check", "{placement}: {share:.0f} % of the fitted walker's signal is not as recorded",
    "What other sensors of this walker read is as uncertain; check where the sensor sat.",
)  # fmt: skip
NOT_FITTED = Kind(
    "sensor_not_fitted", "check", "{placement} took no part in the fit: {reason}",
    "The walker is that of the other sensors alone.",
)  # fmt: skip
LENGTH_DIFFERS = Kind(
    "walker_has_other_strides", "check",
    "the fitted walker's strides are {fitted:.2f} m long, those of the recording {measured:.2f} m",
    "Distances of this walker are off by as much; foot sensors fix the length of the stride best.",
)  # fmt: skip
TOO_MANY = f"no more than {MOST} sensors are compared"
LOST = "it has fewer than two regular strides without lost samples"

LARGEST, OTHER_STRIDE = 0.6, 0.03
"""[1] Unexplained share of a sensor's rate, and relative difference of the lengths of strides, above which a note says
so."""


class StrideSignals(NamedTuple):
    """Mean strides of sensors: angular rate [rad/s] and specific force [m/s²], each (S, POINTS, 3)."""

    gyr: Values
    acc: Values


class Unexplained(NamedTuple):
    """Root mean square difference of a signal over its root mean square variation in the stride [1]; 1: nothing fits.

    Attributes:
        gyr: of the angular rate.
        acc: of the specific force.
    """

    gyr: float
    acc: float


class PersonFit(NamedTuple):
    """A walker fitted to a recording, see `fitted`.

    Attributes:
        person: the walker, who takes about as many steps as the recording shows; for `recording`, `walk`, `covering`.
        unexplained: sensor → what of its mean stride the walker does not explain.
        usual: the same of the usual person at this stride, with which the fit begins.
        axes: sensor → (3, 3) its axes on the segment, in columns.
        place: sensor → its position on the segment [m], see `mount`.
        strides: (n, 2) start and end of the strides in the mean [s].
        late: how much later the measured contacts are than the walker's [s].
        notes: what is in doubt.
    """

    person: Person
    unexplained: dict[str, Unexplained]
    usual: dict[str, Unexplained]
    axes: dict[str, np.ndarray]
    place: dict[str, Vector]
    strides: Float[np.ndarray, "stride 2"]
    late: float
    notes: tuple[Note, ...]


def mean_strides(recording: Recording, windows: Float[np.ndarray, "stride 2"]) -> dict[str, StrideSignals]:
    """Sensor → mean of its signals over strides between two times (n, 2) [s], (POINTS, 3) each.

    Strides in which samples are missing do not count; a sensor without two others is left out.
    """
    share, means = np.arange(POINTS) / POINTS, {}
    for name, imu in recording.sensors.items():
        time, mask = as_float(imu.time), np.asarray(imu.mask)
        good = [mask[slice(*np.searchsorted(time, window))].all() for window in windows]
        at = windows[good, :1] + np.diff(windows[good], axis=1) * share
        if len(at) > 1:
            both = (np.stack([np.interp(at, time, row).mean(axis=0) for row in as_float(part).T], axis=1)
                    for part in (imu.gyr, imu.acc))  # fmt: skip
            means[name] = StrideSignals(*both)
    return means


def stride_of(person: Person, sensors: Sensors, phase: Values = 0.0) -> StrideSignals:
    """What sensors read in a stride of the leg that takes the first step, walking evenly; pure JAX.

    Args:
        person: the person; the number of steps and the variability do not count.
        sensors: the sensors.
        phase: share of the stride by which it begins after the contact [1].
    """
    who = evenly(person, 8, quiet_before=0.5)
    laid, _ = planned(jax.random.key(0), who, straight(30.0), 8)
    time = laid.contact[4] + who.gait.stride_time * (jnp.arange(POINTS) / POINTS + phase)
    return StrideSignals(*ideal_readings(moved(who, laid, *ticks(laid, time)), sensors))


def virtual(person: Person, placements: tuple[str, ...], phase: float = 0.0) -> dict[str, StrideSignals]:
    """Sensor → what it reads in a stride, in the axes of its segment; see `stride_of`. At most `MOST` sensors."""
    who = jax.tree.map(float, person)
    read = compiled(stride_of, quick=True)(who, _sensors(who.body, placements), phase)
    return {name: StrideSignals(*(np.asarray(part)[i] for part in read)) for i, name in enumerate(placements)}


def _sensors(body: Body, placements: tuple[str, ...]) -> Sensors:
    """On the host; the last is repeated until there are `MOST`."""
    if not 0 < len(placements) <= MOST:
        raise ValueError(f"a walker is compared with 1 to {MOST} sensors; got {len(placements)}")
    return sensors_at(body, (*placements, *placements[-1:] * (MOST - len(placements))))


def turned(made: StrideSignals, recorded: StrideSignals) -> Float[Array, "sensor 3 3"]:
    """Rotations (S, 3, 3) that bring the signals of virtual sensors closest to recorded ones.

    Source: W. Kabsch, *Acta Crystallographica A* 32 (1976) 922.
    """
    both = zip(made, recorded, _sizes(recorded), strict=True)
    # Gravity, which all forces contain, is not to decide alone.
    product = sum(jnp.einsum("spi,spj->sij", b, a) / size[:, None, None] ** 2 for a, b, size in both)
    u, _, v = jnp.linalg.svd(product)
    proper = jnp.linalg.det(u @ v)
    return u @ (v * jnp.stack([jnp.ones_like(proper), jnp.ones_like(proper), proper], axis=-1)[..., None])


def _sizes(recorded: StrideSignals) -> list[Values]:
    """Root mean square variation of each signal in the stride (S,)."""
    return [jnp.sqrt(jnp.mean(jnp.sum((part - part.mean(axis=1, keepdims=True)) ** 2, axis=-1), axis=1))
            for part in recorded]  # fmt: skip


def differences(
    made: StrideSignals, recorded: StrideSignals
) -> tuple[Float[Array, "2 sensor point 3"], Float[Array, "sensor 3 3"]]:
    """Differences of rates and forces over their variation in the stride [1], and the rotations of the sensors.

    The constant part of a rate is a bias and does not count.
    """
    made, recorded = (
        StrideSignals(smooth.gyr - smooth.gyr.mean(axis=1, keepdims=True), smooth.acc)
        for smooth in (
            StrideSignals(*(jnp.einsum("pq,sqi->spi", LOW, part) for part in signals)) for signals in (made, recorded)
        )
    )
    turn = turned(made, recorded)
    apart = [
        (jnp.einsum("sij,spj->spi", turn, a) - b) / size[:, None, None]
        for a, b, size in zip(made, recorded, _sizes(recorded), strict=True)
    ]
    return jnp.stack(apart), turn


def unexplained(
    made: StrideSignals, recorded: StrideSignals
) -> tuple[Float[Array, "2 sensor"], Float[Array, "sensor 3 3"]]:
    """Squared unexplained shares of rates and forces (2, S), and the rotations of the sensors (S, 3, 3)."""
    apart, turn = differences(made, recorded)
    return jnp.mean(jnp.sum(apart**2, axis=-1), axis=-1), turn


def _person(numbers: Values, usual: Person, spread: Values) -> Person:
    """The person at numbers (FREE,) of standard deviations."""
    moved = {name: number * wide for name, number, wide in zip(FREE, numbers, spread, strict=True)}

    def grown(part: Body | Gait) -> dict[str, Values]:
        return {name: getattr(part, name) * jnp.exp(moved[name]) for name in SIZES if name in part._fields}

    styles = {name: moved[name] for name in STYLES}
    return Person(usual.body._replace(**grown(usual.body)), usual.gait._replace(**grown(usual.gait), **styles))


@partial(jax.vmap, in_axes=(0, *(None,) * 4))
def _compared(
    numbers: Values, usual: Person, spread: Values, sensors: Sensors, recorded: StrideSignals
) -> tuple[Float[Array, "2 sensor point 3"], Float[Array, "sensor 3 3"]]:
    """`differences` of walkers at numbers (n, NUMBERS) of standard deviations: of the person, places, and the phase."""
    who = _person(numbers[: len(FREE)], usual, spread)
    worn = sensors._replace(point=sensors.point + PLACE * numbers[len(FREE) : -1].reshape(MOST, 3))
    return differences(stride_of(who, worn, PHASE * numbers[-1]), recorded)


def fitted(recording: Recording, person: Mapping[str, PyTree] | None = None) -> PersonFit:
    """The walker whose virtual sensors are closest to a recording.

    `jgait.analyse` gives contacts, stride time and length; the manner of walking, lengths of legs that are not given,
    and how the sensors sit on their segments are fitted to the mean stride by least squares.

    Args:
        recording: of a person who walks; up to seven sensors take part.
        person: measures of the person [m], as far as known, see `jgait.analyse`: "height", "thigh_length" …

    Returns:
        The walker, and what of each sensor's stride it does not explain. `simulate.recording(key, fit.person,
        placements=…)` is what other sensors would have recorded.

    Raises:
        ValueError: if the recording has fewer than two regular strides of one foot, or if every sensor lost samples in
            all but one of them.
    """
    analysis = analyse(recording, person)
    measures = dict(person or {})
    windows, usual, known, length_error = _start(analysis, measures)
    signals = mean_strides(recording, windows)
    names = tuple(list(signals)[:MOST])
    if not names:
        raise ValueError("no sensor was read throughout two regular strides")
    padded = (*names, *names[-1:] * (MOST - len(names)))
    recorded = StrideSignals(
        *(np.stack([getattr(signals[name], kind) for name in padded]) for kind in StrideSignals._fields)
    )
    spreads = {**dict.fromkeys(FREE, 1.0), **SPREAD, **dict.fromkeys(known, 0.0), "stride_length": length_error}
    spread = np.array([spreads[name] for name in FREE])
    sensors = _sensors(usual.body, names)
    weights = (np.arange(MOST) < len(names)).astype(float)
    begin, numbers, found = _nearest(weights, jax.tree.map(float, usual), spread, sensors, recorded)
    shares = [np.mean(np.sum(apart**2, axis=-1), axis=-1) for apart, _ in (begin, found)]
    before, after = ({name: Unexplained(*map(float, np.sqrt(part[:, i]))) for i, name in enumerate(names)}
                     for part in shares)  # fmt: skip
    who = jax.tree.map(float, _person(numbers[: len(FREE)], usual, spread))
    who = able(jax.random.key(0), who, straight(30.0))
    points = np.asarray(sensors.point) + PLACE * numbers[len(FREE) : -1].reshape(MOST, 3)
    notes = not_fitted(recording, signals, names)
    notes += tuple(
        POOR(placement=name, share=100.0 * share.gyr) for name, share in after.items() if share.gyr > LARGEST
    )
    length, measured = who.gait.stride_length, usual.gait.stride_length
    if abs(np.log(length / measured)) > OTHER_STRIDE:
        notes = (*notes, LENGTH_DIFFERS(fitted=length, measured=float(measured)))
    return PersonFit(
        who, after, before, {name: found[1][i].T for i, name in enumerate(names)},
        {name: Vector(*map(float, points[i])) for i, name in enumerate(names)}, windows,
        PHASE * float(numbers[-1]) * float(who.gait.stride_time), notes,
    )  # fmt: skip


def not_fitted(recording: Recording, seen: Collection[str], fitted: Collection[str]) -> tuple[Note, ...]:
    """A note for each sensor of a recording that is not fitted; `seen`: those with mean strides."""
    return tuple(
        NOT_FITTED(placement=name, reason=TOO_MANY if name in seen else LOST)
        for name in recording.sensors if name not in fitted
    )  # fmt: skip


def _nearest(weights: np.ndarray, *given: PyTree) -> tuple[PyTree, np.ndarray, PyTree]:
    """What is compared at the begin, the numbers with the least loss, and what is compared there.

    By the method of Levenberg and Marquardt, with slopes by differences: one program of many walkers, without
    derivatives, compiles in a third of the time.
    """
    program = compiled(_compared, quick=True)
    weigh = np.sqrt(COUNT * weights / POINTS)[:, None, None] / np.array(EXPECTED)[:, None, None, None]

    def compared(numbers: np.ndarray) -> tuple[np.ndarray, PyTree]:
        """Rows of which the loss is the sum of squares, and what is compared by the first."""
        apart, turn = map(np.asarray, program(numbers, *given))
        return np.concatenate([(weigh * apart).reshape(len(numbers), -1), numbers], axis=1), (apart[0], turn[0])

    moves = np.concatenate([np.zeros((1, NUMBERS)), MOVE * np.eye(NUMBERS)])
    begins = 0.0 * moves
    begins[: len(BEGINS), -1] = BEGINS
    best = begins[np.argmin(np.sum(compared(begins)[0][: len(BEGINS)] ** 2, axis=1))]
    rows, begin = compared(best + moves)
    found, least, damping = begin, float(np.sum(rows[0] ** 2)), 0.25
    for _ in range(ROUNDS):
        slope = (rows[1:] - rows[0]) / MOVE
        trial = best - np.linalg.solve(slope @ slope.T + damping * np.eye(NUMBERS), slope @ rows[0])
        others, there = compared(trial + moves)
        loss = float(np.sum(others[0] ** 2))
        gain = least - loss
        if not gain > 0.0:
            damping *= 8.0
            continue
        best, rows, found, least, damping = trial, others, there, loss, damping / 4.0
        if gain < ENOUGH * loss:
            break
    return begin, best, found


def _start(
    analysis: Analysis, measures: Mapping[str, PyTree]
) -> tuple[Float[np.ndarray, "stride 2"], Person, frozenset[str], float]:
    """Times of the strides that count, the usual person at this stride, the lengths that are known, and the standard
    deviation of the logarithm of the stride's length.
    """
    joined = analysis.strides
    feet = np.zeros((2, 0), bool) if joined is None else np.asarray(joined.strides.side) == [[0], [1]]
    use = feet if joined is None else feet & regular(joined)
    counts = use.sum(axis=1)
    side = int(np.argmax(counts))
    if joined is None or counts[side] < 2:
        raise ValueError(
            f"a walker is fitted to two or more regular strides of one foot; there are {counts[0]} of the right and "
            f"{counts[1]} of the left"
        )
    start, end, length = (as_float(getattr(joined.strides, name))[use[side]] for name in ("start", "end", "length"))
    windows = np.stack([start, end], axis=1)
    times = end - start
    height = float(measures.get("height", 1.75))
    lengths = {name: float(np.mean(measures[name])) for name in ("thigh_length", "shank_length") if name in measures}
    body = Body(*(value * height / 1.75 for value in Body()))._replace(**lengths)
    stride = float(np.median(length))
    error = float(np.median(as_float(joined.stddev.length)[use[side]])) / stride
    usual = gait(stride_length=stride, cadence=120.0 / float(np.median(times)), stature=height, usual=RECORDED)
    grows = manner(stride / (body.thigh_length + body.shank_length), RECORDED)
    follows = {name: float(value) for name, value in grows.items()}
    irregular = float(np.sqrt(2.0) * np.std(times) / np.mean(times))
    # Of n steps and the closing one, the first foot takes n / 2 + 1, the other n / 2.
    most, least = sorted(feet.sum(axis=1), reverse=True)
    steps = most + (least if most - least <= 1 else most) - 1.0
    walker = usual._replace(
        **follows, soft_tissue=1.0, right_first=float(SIDES[side] == "right"), time_variability=min(irregular, 0.15),
        steps=float(min(steps, MOST_STEPS)),
    )  # fmt: skip
    return windows, Person(body, walker), frozenset(lengths), error
