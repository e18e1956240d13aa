r"""Two feet's inertial sensors in one state, tied together when a range says that one passes the other.

State: two `FootState`, each counting its position p from its last foothold in a horizontal world of its own; the angle
ψ by which the left foot's world is turned from the right one's; and the way d from the left foot's last foothold to the
right one's. The world is the right foot's. When a foot leaves a foothold, its stride becomes part of that way:

    d' = d + p_R   (right),    d' = d − R(ψ) p_L   (left)

Between the feet lies D = d + p_R − R(ψ) p_L at any time. With w the direction in which they walk, that of the sum of
both velocities, the distances across and along are

    z₁ = D_x w_y − D_y w_x,    z₂ = D · w

A range r heard while one leg passes the other says that z₂ = 0 or nearly so, and that z₁ = √(r² − z₂²), as it is read
at the closest that the pings come to the passing and not at the passing itself.

Numbers stay small however long the walk. ψ is part of the state, beside the attitudes, because the left foot's start is
known but for 10° or so: a turn of a whole world is no small error, and so the attitude, the velocity and the stride are
kept apart from it, exact whatever it is. The width of a stride takes three places at three times; at the stride's
end the state holds all three, so that no place need be copied.

Source: the future work of Potter, Liu, Selamet and Kumaravelu, "EKF estimation of stride width from individual
IMU-based foot trajectory estimates"; z₁ and z₂ are their equation 6. Each foot is `foot_model`.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jgait.estimators.foot_ins import model as foot_model
from jgait.estimators.foot_ins.model import FootControl, FootError, FootModelParams, FootObservation, FootState
from jgait.filtering import Belief, Covariance, Model

SLOW = 0.1
"""[m/s] Feet slower than this tell little about the direction of the walk; that of their strides is then taken."""


class Plane(NamedTuple):
    """Two horizontal components."""

    x: Any
    y: Any


class TwoFeetState(NamedTuple):
    """Both feet, `yaw` ψ [rad], and `between` d [m], in the world of the right foot."""

    right: FootState
    left: FootState
    yaw: Any
    between: Plane


class TwoFeetError(NamedTuple):
    """Its error: as `TwoFeetState`, with rotation vectors for the attitudes."""

    right: FootError
    left: FootError
    yaw: Any
    between: Plane


class TwoFeetControl(NamedTuple):
    """What both sensors read over one interval, and the range at its end.

    Attributes:
        right: right foot.
        left: left foot.
        distance: range r [m]; where there is none, any positive number.
        late: how long after the sample it was read [s].
        ahead: direction of the right foot's stride, in its world [1].
        dt_right: length of the interval [s]; 0 until the right foot stands first, where its filter starts.
        dt_left: the same of the left foot.
    """

    right: FootControl
    left: FootControl
    distance: Any
    late: Any
    ahead: Plane
    dt_right: Any
    dt_left: Any


class TwoFeetObservation(NamedTuple):
    """Each foot's zero velocity and height; z₁ [m] as the range and its offset say, and z₂ [m]."""

    right: FootObservation
    left: FootObservation
    across: Any
    along: Any


class TwoFeetModelParams(NamedTuple):
    """What the model needs to know.

    Attributes:
        foot: of each foot.
        passing: z₂ expected when a range comes [m].
        range_variance: of the range [m²].
        passing_variance: of z₂ when a range comes [m²].
    """

    foot: FootModelParams
    passing: Any
    range_variance: Any
    passing_variance: Any


def turned(angle: Any, v: Any) -> Plane:
    """The horizontal part of a vector, turned to the left by an angle."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    return Plane(c * v.x - s * v.y, s * v.x + c * v.y)


def relative(s: TwoFeetState, late: Any = 0.0) -> Plane:
    """D, from the left foot to the right one, some time after the state's [m]."""
    left = turned(s.yaw, Plane(*(getattr(s.left.position, a) + late * getattr(s.left.velocity, a) for a in "xy")))
    right = Plane(*(getattr(s.right.position, a) + late * getattr(s.right.velocity, a) for a in "xy"))
    return Plane(s.between.x + right.x - left.x, s.between.y + right.y - left.y)


def transition(p: TwoFeetModelParams, s: TwoFeetState, u: TwoFeetControl, dt: Any) -> TwoFeetState:
    """A foothold that is left moves `between`; the feet move on their own, each over its own interval."""
    del dt
    went = turned(s.yaw, s.left.position)
    r, q = u.right.restart, u.left.restart
    between = Plane(
        s.between.x + r * s.right.position.x - q * went.x, s.between.y + r * s.right.position.y - q * went.y
    )
    return TwoFeetState(
        foot_model.transition(p.foot, s.right, u.right, u.dt_right),
        foot_model.transition(p.foot, s.left, u.left, u.dt_left),
        s.yaw,
        between,
    )


def fold_error(p: TwoFeetModelParams, s: TwoFeetState, e: TwoFeetError, u: TwoFeetControl, dt: Any) -> TwoFeetError:
    """First δ_d' = δ_d + δ_pR, or δ_d − R(ψ) δ_pL − δ_ψ ẑ × R(ψ) p_L."""
    del p, dt
    went, change = turned(s.yaw, s.left.position), turned(s.yaw, e.left.position)
    r, q = u.right.restart, u.left.restart
    return e._replace(
        between=Plane(
            e.between.x + r * e.right.position.x - q * (change.x - e.yaw * went.y),
            e.between.y + r * e.right.position.y - q * (change.y + e.yaw * went.x),
        )
    )


type _Step = Callable[[Any, Any, Any, Any, Any], Any]


def turn_error(p: TwoFeetModelParams, s: TwoFeetState, e: TwoFeetError, u: TwoFeetControl, dt: Any) -> TwoFeetError:
    """Then what `foot_model.turn_error` does, on both feet."""
    del dt
    return _of_both(foot_model.turn_error, p, s, e, u)


def move_error(p: TwoFeetModelParams, s: TwoFeetState, e: TwoFeetError, u: TwoFeetControl, dt: Any) -> TwoFeetError:
    """At last what `foot_model.move_error` does, on both feet."""
    del dt
    return _of_both(foot_model.move_error, p, s, e, u)


def _of_both(step: _Step, p: TwoFeetModelParams, s: TwoFeetState, e: TwoFeetError, u: TwoFeetControl) -> TwoFeetError:
    return e._replace(
        right=step(p.foot, s.right, e.right, u.right, u.dt_right), left=step(p.foot, s.left, e.left, u.left, u.dt_left)
    )


def transition_noise(p: TwoFeetModelParams, s: TwoFeetState, u: TwoFeetControl, dt: Any) -> Covariance:
    """Of each foot; what lies between footholds does not change by itself."""
    del dt
    noises = {
        side: foot_model.transition_noise(p.foot, getattr(s, side), getattr(u, side), getattr(u, f"dt_{side}"))
        for side in _SIDES
    }
    none = Covariance.from_variances(
        TwoFeetError(noises["right"].variances(), noises["left"].variances(), 0.0, Plane(0.0, 0.0))
    )
    return none.with_entries({
        (f"{side}.position.{axis}", f"{side}.velocity.{axis}"): noise[f"position.{axis}", f"velocity.{axis}"]
        for side, noise in noises.items()
        for axis in "xyz"
    })  # fmt: skip


_SIDES = ("right", "left")


def passing(p: TwoFeetModelParams, s: TwoFeetState, u: TwoFeetControl) -> tuple[Any, Any]:
    """z₁ + r − √(r² − z₂²), which is what a range and its offset should add up to, and z₂ [m]."""
    d = relative(s, u.late)
    left = turned(s.yaw, s.left.velocity)
    x = s.right.velocity.x + left.x + SLOW * u.ahead.x
    y = s.right.velocity.y + left.y + SLOW * u.ahead.y
    speed = jnp.sqrt(x * x + y * y + (0.01 * SLOW) ** 2)
    across, along = (d.x * y - d.y * x) / speed, (d.x * x + d.y * y) / speed
    square = u.distance * u.distance
    off = jnp.minimum((along - p.passing) ** 2, 0.75 * square)  # a start that is far off must not spoil the root
    return across + u.distance - jnp.sqrt(square - off), along


def observation(p: TwoFeetModelParams, s: TwoFeetState, u: TwoFeetControl) -> TwoFeetObservation:
    """Of each foot, and between them."""
    across, along = passing(p, s, u)
    return TwoFeetObservation(
        foot_model.observation(p.foot, s.right, u.right), foot_model.observation(p.foot, s.left, u.left),
        across,
        along,
    )  # fmt: skip


def error_observation(p: TwoFeetModelParams, s: TwoFeetState, e: TwoFeetError, u: TwoFeetControl) -> TwoFeetObservation:
    """By how much an error changes the observation; positions, velocities and ψ add, and no attitude shows in z."""
    none = jax.tree.map(jnp.zeros_like, s)
    change = TwoFeetState(
        none.right._replace(position=e.right.position, velocity=e.right.velocity),
        none.left._replace(position=e.left.position, velocity=e.left.velocity),
        e.yaw,
        e.between,
    )
    _, (across, along) = jax.jvp(lambda at: passing(p, at, u), (s,), (change,))
    return TwoFeetObservation(
        foot_model.error_observation(p.foot, s.right, e.right, u.right),
        foot_model.error_observation(p.foot, s.left, e.left, u.left),
        across,
        along,
    )


def observation_noise(p: TwoFeetModelParams, s: TwoFeetState, u: TwoFeetControl) -> TwoFeetObservation:
    """Of each foot, of the range, and of the feet being side by side."""
    return TwoFeetObservation(
        foot_model.observation_noise(p.foot, s.right, u.right),
        foot_model.observation_noise(p.foot, s.left, u.left),
        p.range_variance,
        p.passing_variance,
    )


def retract(s: TwoFeetState, e: TwoFeetError) -> TwoFeetState:
    """The state at an error from another."""
    return TwoFeetState(
        foot_model.retract(s.right, e.right), foot_model.retract(s.left, e.left), s.yaw + e.yaw,
        Plane(s.between.x + e.between.x, s.between.y + e.between.y),
    )  # fmt: skip


def local(reference: TwoFeetState, s: TwoFeetState) -> TwoFeetError:
    """The error of a state about another."""
    return TwoFeetError(
        foot_model.local(reference.right, s.right), foot_model.local(reference.left, s.left), s.yaw - reference.yaw,
        Plane(s.between.x - reference.between.x, s.between.y - reference.between.y),
    )  # fmt: skip


def error_shift(reference: TwoFeetState, delta: TwoFeetError, e: TwoFeetError) -> TwoFeetError:
    """An error beside another; only rotation vectors do not add."""
    return e._replace(
        right=foot_model.error_shift(reference.right, delta.right, e.right),
        left=foot_model.error_shift(reference.left, delta.left, e.left),
    )


def initial(p: TwoFeetModelParams) -> Belief:
    """At rest, side by side, 0.15 m apart; a recording brings its own, see `joined_belief`."""
    foot = foot_model.initial(p.foot)
    return joined_belief(foot, foot, 0.0, 0.0, 0.15, (0.15, 0.5, 0.2))


def joined_belief(
    right: Belief, left: Belief, heading: Any, yaw: Any, width: Any, stddev: tuple[Any, Any, Any]
) -> Belief:
    """The belief before the first sample.

    Args:
        right: of the right foot alone.
        left: of the left foot alone.
        heading: of the right foot's first stride in its world [rad].
        yaw: ψ [rad].
        width: distance across [m]; along it is 0.
        stddev: of the distance across [m], of that along [m], and of ψ [rad].
    """
    across, along, turn = stddev
    c, s = jnp.cos(heading), jnp.sin(heading)
    mean = TwoFeetState(right.mean, left.mean, 0.0 * c + yaw, Plane(width * s, -width * c))
    side, ahead = across**2, along**2
    variances = TwoFeetError(
        right.cov.variances(), left.cov.variances(), 0.0 * c + turn**2,
        Plane(side * s * s + ahead * c * c, side * c * c + ahead * s * s),
    )  # fmt: skip
    entries = {("between.x", "between.y"): (ahead - side) * s * c}
    for name, foot in (("right", right), ("left", left)):
        names = foot.cov.names
        entries |= {(f"{name}.{a}", f"{name}.{b}"): foot.cov[a, b] for i, a in enumerate(names) for b in names[i + 1 :]}
    return Belief(mean, Covariance.from_variances(variances).with_entries(entries))


MODEL = Model(
    initial, transition, transition_noise, observation, observation_noise, retract, local, None,
    (fold_error, turn_error, move_error), error_observation, error_shift,
)  # fmt: skip
"""Both feet."""
