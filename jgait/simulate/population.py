"""Many people: adults drawn from published norms, each made to cover a route.

`population` draws people, `gait` computes the parameters of a gait from figures printed in papers, `covering` scales
the stride length so that a whole number of steps covers a route, `cohort` simulates a walk of each person.
"""

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from jgait.estimators.programs import bucket, compiled
from jgait.geometry.vectors import kept
from jgait.simulate import routes
from jgait.simulate.footsteps import FIRST, footholds
from jgait.simulate.person import DEGREE, RECORDED, TABLES, Body, Gait, Person
from jgait.simulate.recorded import limits, room, walks
from jgait.simulate.routes import Route, padded, straight
from jgait.simulate.sensors import IDEAL, ImuErrors
from jgait.simulate.shapes import STYLES
from jgait.simulate.worn import SEVEN, Truth
from jgait.types import Recording, Values, check_key, check_kind, check_number

SPEED = ((1.358, 1.433, 1.434, 1.433, 1.339, 1.262), (1.341, 1.337, 1.390, 1.313, 1.241, 1.132))
"""Mean walking speed [m/s] of men and of women in their twenties, thirties … seventies."""

STATURE = ((1.755, 0.070), (1.620, 0.065))
"""Mean and standard deviation of the stature of men and of women [m]."""

WALK_RATIO = 0.0033
"""Step length over cadence [m/(steps/min)] for each metre of stature; about the same at all but slow speeds."""

_USUAL = Gait()
_USUAL_STRIDE = _USUAL.stride_length / (Body().thigh_length + Body().shank_length)
_MANNER = {
    "toe_up": (1, 45.0 * DEGREE), "heel_up": (1, 92.0 * DEGREE), "pelvis_surge": (1, 0.05), "pelvis_rise": (2, 0.08),
}  # fmt: skip
"""Gait parameters that grow with the stride: power of the stride over the leg, and upper limit."""

_MANNER_RECORDED = {name: (TABLES["powers"][name], most) for name, most in {
    "toe_up": 45.0 * DEGREE, "heel_up": 98.0 * DEGREE, "pelvis_surge": 0.05, "pelvis_rise": 0.08, "landing_speed": 0.8,
    "hip_ahead": 0.05,
}.items()}  # fmt: skip
"""The same of recorded people, whose limits are chosen."""

PELVIS_SPREAD = {
    "pelvis_rise": 0.13, "pelvis_surge": 0.23, "pelvis_sway": 0.33, "pelvis_rotation": 0.70, "pelvis_drop": 0.56,
    "pelvis_nod": 0.58,
}  # fmt: skip
"""[1] Standard deviation between recorded people of the logarithm of each motion of the pelvis at one stride, of the
first harmonic of the lower backs of 12 people of `ipol_gait` (`experiments.people.shapes`)."""

PERSISTENCE, PITCH_VARIABILITY = 0.4, 0.04
"""[1] Of recorded people, by the feet of 12 people of `ipol_gait` on straight parts.

The length of a stride correlates by 0.29 with that of the foot's next stride, which a persistence φ of steps gives by
φ (1 + φ) / 2. The pitch of the foot varies by 3.5 % of its mean at toe-off and by 5.8 % at landing (median absolute
deviation), of simulated feet without this variability by 0.4 and 4.8 %, which is taken off.
"""

_FREE = ("swing_lift", "landing_speed", "pelvis_sway", "pelvis_rotation", "pelvis_drop", "pelvis_nod", "pelvis_shock",
         "foot_flat")  # fmt: skip
"""Gait parameters that vary from person to person independently of the stride."""


def manner(relative_stride: Values, usual: Gait = _USUAL) -> dict[str, Values]:
    """Fields of a gait that grow with the stride over the length of the leg [1]: foot pitch, rise and surge of the
    pelvis; of `RECORDED` also where the hips are at landing, and how fast the foot lands.

    By the rules they are proportional to the stride, and the rise to its square, as in an inverted pendulum. The
    stride counts as a third of the usual one at least.
    """
    share = jnp.maximum(relative_stride / _USUAL_STRIDE, 1.0 / 3.0)
    grows = _MANNER_RECORDED if usual is RECORDED else _MANNER
    return {name: jnp.minimum(getattr(usual, name) * share**power, most) for name, (power, most) in grows.items()}


def gait(
    speed: float | None = None, stride_length: float | None = None, cadence: float | None = None,
    stature: float | None = None, usual: Gait = _USUAL, **others: Values,
) -> Gait:  # fmt: skip
    """A gait from any two of speed, stride length and cadence, or from speed and stature.

    v = L c / 120;  from speed and stature alone the walk ratio gives the cadence: L / 2 = w H c.

    Args:
        speed: walking speed v [m/s].
        stride_length: L [m].
        cadence: c [steps/min].
        stature: H [m], for the length of the legs; None for 1.75.
        usual: where other fields are taken from: the rules, or `RECORDED`.
        **others: other fields of `Gait`, in their units; they are not changed.

    Returns:
        The gait; foot pitch and motion of the pelvis fit the stride.

    Raises:
        ValueError: if fewer than two are given, three contradict each other by more than 1 %, or one is not positive or
            larger than any person's.
        TypeError: if one is no number.

    Source: `WALK_RATIO`, see `population`.
    """
    given = {"speed": speed, "stride_length": stride_length, "cadence": cadence}
    # above any person's: a value in another unit is refused
    for (name, value), most in zip({**given, "stature": stature}.items(), (13.0, 6.0, 500.0, 2.8), strict=True):
        if value is not None:
            check_number(value, f"{name} must be a number")
            if not 0.0 < value <= most:
                raise ValueError(f"{name} must be above 0 and at most {most:g}; got {value!r}")
    known = {name: value for name, value in given.items() if value is not None}
    height = 1.75 if stature is None else stature
    if set(known) == {"speed"} and stature is not None:
        known["cadence"] = math.sqrt(60.0 * known["speed"] / (WALK_RATIO * height))
    if len(known) < 2:
        raise ValueError(
            "a gait needs two of speed [m/s], stride_length [m] and cadence [steps/min], or speed and stature [m]; "
            f"got {', '.join(f'{k}={v:g}' for k, v in known.items()) or 'none'}"
        )
    beat = known["cadence"] if "cadence" in known else 120.0 * known["speed"] / known["stride_length"]
    length = known["stride_length"] if "stride_length" in known else 120.0 * known["speed"] / beat
    made = length * beat / 120.0
    if abs(made / known.get("speed", made) - 1.0) > 0.01:
        raise ValueError(
            f"speed={speed:g} m/s contradicts stride_length={length:g} m and cadence={beat:g} steps/min, which make "
            f"{made:.3f} m/s; give two of them"
        )
    body = Body()
    leg = (body.thigh_length + body.shank_length) * height / 1.75
    manners = {name: float(value) for name, value in manner(length / leg, usual).items()}
    return usual._replace(**{"stride_length": length, "stride_time": 120.0 / beat, **manners, **others})


def paced(person: Person, factor: Values) -> Person:
    """The same person with strides longer and quicker by a factor [1]; the speed grows with the factor's square.

    The walk ratio stays the same; the foot's pitch and the pelvis' motion change with the stride.
    """
    body, gait = person.body, person.gait
    leg = body.thigh_length + body.shank_length
    follows: dict[str, Values] = {}
    for usual, share in ((_USUAL, 1.0 - gait.recorded), (RECORDED, gait.recorded)):
        before, after = (manner(gait.stride_length * longer / leg, usual) for longer in (1.0, factor))
        for name in after:
            grown = follows.get(name, getattr(gait, name))
            follows[name] = grown * (1.0 + share * (after[name] / before[name] - 1.0))
    faster = {"stride_length": gait.stride_length * factor, "stride_time": gait.stride_time / factor}
    return Person(body, gait._replace(**faster, **follows))


def _adult(key: PRNGKeyArray, recorded: bool) -> Person:
    """One adult; see `population`."""
    usual = RECORDED if recorded else _USUAL
    even = iter(kept(jax.random.uniform(key, (8,))))
    normal = iter(kept(jax.random.truncated_normal(jax.random.fold_in(key, 1), -2.0, 2.0, (48,))))

    def around(mean: Values, deviation: Values) -> Values:
        return mean + deviation * next(normal)

    woman, age = (next(even) < 0.5).astype(int), 20.0 + 60.0 * next(even)
    decade = jnp.clip((age - 20.0) / 10.0, 0.0, 5.999).astype(int)
    middle, width = jnp.asarray(STATURE)[woman]
    stature = around(middle, width)
    lengths = {name: around(1.0, 0.02) * value * stature / 1.75 for name, value in Body()._asdict().items()}
    leg = lengths["thigh_length"] + lengths["shank_length"]
    # Taller people walk faster; the walk ratio gives stride and cadence for a speed.
    speed = jnp.asarray(SPEED)[woman, decade] * around(1.0, 0.10) * jnp.sqrt(stature / middle)
    cadence = jnp.sqrt(60.0 * speed / (around(1.0, 0.05) * WALK_RATIO * stature))
    stride = 120.0 * speed / cadence

    # Most parameters vary from person to person by a tenth; angles of the foot by less.
    def varied(name: str, deviation: float) -> Values:
        if recorded and name in PELVIS_SPREAD:
            return jnp.exp(PELVIS_SPREAD[name] * next(normal))
        return around(1.0, deviation)

    spread = {name: varied(name, 0.10) for name in _FREE}
    follows = {name: value * varied(name, 0.04) for name, value in manner(stride / leg, usual).items()}
    gait = usual._replace(
        stride_length=stride, stride_time=120.0 / cadence,
        stance_fraction=around(usual.stance_fraction, 0.008) - 0.02 * (speed - 1.3),
        heel_off=around(usual.heel_off, 0.015), step_width=around(0.10, 0.025),
        toe_out=around(usual.toe_out, 2.5 * DEGREE), knee_stance=around(usual.knee_stance, 1.0 * DEGREE),
        hip_ahead=around(usual.hip_ahead, 0.005), standing_hip=around(2.0, 1.5) * DEGREE,
        standing_knee=around(5.0, 1.5) * DEGREE, length_asymmetry=around(0.0, 0.01), time_asymmetry=around(0.0, 0.01),
        length_variability=around(0.030, 0.006), time_variability=around(0.025, 0.005),
        width_variability=around(0.017, 0.004),
        right_first=jnp.where(next(even) < 0.5, 1.0, 0.0), quiet_after=1.0 + next(even),
        **{name: value * getattr(usual, name) for name, value in spread.items()},
    )  # fmt: skip
    gait = gait._replace(**follows)
    if recorded:
        gait = gait._replace(
            **{name: around(0.0, 1.0) for name in STYLES}, soft_tissue=around(1.0, 0.1), persistence=PERSISTENCE,
            pitch_variability=PITCH_VARIABILITY,
        )  # fmt: skip
    return Person(Body(**lengths), gait)


def _adults(key: PRNGKeyArray, *, n: int, recorded: bool) -> Person:
    drawn = jax.vmap(lambda i: _adult(jax.random.fold_in(key, i), recorded))(jnp.arange(n))
    return jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, float), (n,)), drawn)


def population(key: PRNGKeyArray, n: int, recorded: bool = True) -> Person:
    """Draw `n` healthy adults of 20 to 79 years, half of them women; every field of the result is (n,).

    The first people are the same for any n. Lengths of the body are proportional to stature H, as in `Body`, each with
    a spread of 2 %. Speed is the mean of sex and decade times the root of the relative stature, spread 10 %; step
    length over cadence is w H, spread 5 %, so the stride grows with H and speed, and with it `manner`.

    Feet, pelvis and sensors move as those of recorded people do (`RECORDED`), each person in a style of its own, with a
    pelvis that moves more or less (`PELVIS_SPREAD`); steps resemble the ones before, and the pitch of the foot varies.
    Without `recorded`, they move by simpler rules, and sensors are fixed to bones.

    All spreads are standard deviations of normal distributions, truncated at two standard deviations.

    Raises:
        ValueError: if `n` is not positive.

    Source: proportions of Drillis and Contini as given by Winter, *Biomechanics and Motor Control of Human Movement*.
    Speeds: Bohannon and Andrews, *Physiotherapy* 97 (2011) 182, table of means. Walk ratio: 0.655 m at 119 steps/min of
    8429 Japanese adults in daily life, *Geriatr Gerontol Int* 20 (2020) 664, for an assumed stature of 1.65 m; that it
    holds at all but slow speeds: Murakami and Otaka, *J Phys Ther Sci* 29 (2017) 722. Variability of the step's width
    2.4 cm (young adults of Almarwani and others, tabulated by Skiadopoulos and others, *J NeuroEng Rehabil* 17 (2020)),
    √2 of that of a foothold; of step length and time below 6 %: Gabell and Nayak, *J Gerontol* 39 (1984) 662, within
    which 3 % and 2.5 % are chosen. Stature: round values near those of US adults. Chosen: every other spread, the mean
    step width of 10 cm, the effect of speed on stance, asymmetries of 1 %, the pose when standing.
    """
    check_key(key)
    check_kind(n, (int, np.integer), "n must be a whole number")
    if n < 1:
        raise ValueError(f"population needs at least one person; got n={n}")
    drawn: Person = compiled(_adults, quick=True)(key, n=bucket(n, 16), recorded=recorded)
    return jax.tree.map(lambda leaf: np.asarray(leaf)[:n], drawn)


def person_of(people: Person, i: int) -> Person:
    """The person with number `i` of a population, with fields as floats."""
    return jax.tree.map(lambda leaf: float(np.asarray(leaf)[i]), people)


def covering(key: PRNGKeyArray, person: Person, along: Route) -> Person:
    """The person with a whole number of steps that covers the route exactly, with the least change of stride length.

    `key` is that of the later call of `recording` or `walk`; it determines the variability from step to step. `steps`
    and `stride_length` are set, foot pitch and pelvis adapted. Where a leg would be overstretched (some 2 in 100 of
    `population` on 20 m, by less than a millimetre), `knee_stance` is raised as much as necessary, up to 4°; if more is
    needed, it stays unchanged and simulating the walk raises an error.

    Raises:
        ValueError: if the route is shorter than half a step.
    """
    check_key(key)
    check_kind(person, Person, "person must be a jgait.simulate.Person")
    check_kind(along, Route, "along must be a Route, such as jgait.simulate.straight(10.0)")
    speeds = np.sqrt(np.asarray(along.speed, float))
    steps = round(float(np.sum(np.asarray(along.length) / speeds)) / (0.5 * float(person.gait.stride_length)))
    if steps < 1:
        total = float(np.sum(along.length))
        raise ValueError(f"a route of {total:g} m is shorter than half a step of {0.5 * person.gait.stride_length:g} m")
    person = Person(person.body, person.gait._replace(steps=float(steps)))
    grown = compiled(_stretched, quick=True)(key, jax.tree.map(float, person), padded(along), capacity=room(steps))
    # The step time of the person does not change.
    stretched = grown.gait._replace(stride_time=person.gait.stride_time)
    return able(key, jax.tree.map(float, Person(person.body, stretched)), along)


def able(key: PRNGKeyArray, person: Person, along: Route) -> Person:
    """The person with knees bent just enough that no leg is overstretched; see `covering`."""
    able = person
    for _ in range(4):
        *_, left = limits(key, able, along)
        if left.stretched > 0.0:
            return able
        # A leg whose knee bends by a small angle k is shorter than a straight one by about k² / 8; 1e-4 are kept.
        bent = math.sqrt(able.gait.knee_stance**2 + 8.0 * (1e-4 - left.stretched))
        able = Person(person.body, person.gait._replace(knee_stance=bent))
        if bent > person.gait.knee_stance + 4.0 * DEGREE:
            break
    return person


def _stretched(key: PRNGKeyArray, person: Person, along: Route, *, capacity: int) -> Person:
    """The person paced by the factor on the stride length with which the last step ends at the end of the route."""
    walks = jax.random.split(key)[0]
    total = routes.total_length(along)
    on_spot = total - routes.walked_length(along)

    def covered(stride: Values) -> Values:
        stretched = Person(person.body, person.gait._replace(stride_length=stride))
        laid = footholds(walks, stretched, along, capacity)
        # At the end of the last interval r = 1, where a polynomial is the sum of its coefficients.
        return jnp.sum(laid.distance_curve[laid.end.astype(int) - 1 + FIRST]) + on_spot

    # The distance is nearly proportional to the stride; where speed changes, each iteration divides the error by ten.
    usual = jnp.asarray(person.gait.stride_length)
    return paced(person, jax.lax.fori_loop(0, 16, lambda _, stride: stride * total / covered(stride), usual) / usual)


def cohort(
    key: PRNGKeyArray, n: int, along: Route | list[Route] | None = None, errors: ImuErrors = IDEAL,
    rate: float = 100.0, placements: Sequence[str] = SEVEN, *, recorded: bool = True,
) -> list[tuple[Recording, Truth]]:  # fmt: skip
    """Simulate one walk of each of `n` people drawn from `population`, with individual steps along a route.

    `along` is the route of all people or a list with that of each; None is 20 m straight ahead. `recorded` as of
    `population`, other arguments as of `recording`. Returns recording and truth of each person, with the names
    subject_0001 and so on. The truth of a minute at 100 Hz takes some 12 MB; `walks` returns walks one by one.

    Raises:
        ValueError: if `n` is not positive, or as `walks`.
    """
    ways = along if isinstance(along, list) else [straight(20.0) if along is None else along] * n
    who, how = jax.random.split(key)
    people = population(who, n, recorded)
    keys = [jax.random.fold_in(how, i) for i in range(n)]
    fit = [covering(key, person_of(people, i), way) for i, (key, way) in enumerate(zip(keys, ways, strict=True))]
    return list(walks(keys, fit, ways, errors, rate, placements))
