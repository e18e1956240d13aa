r"""State-space model of two feet in the plane: their displacements, and the range between them.

    x ← x + Δx cos(θ + Δθ) − Δy sin(θ + Δθ),  y ← y + Δy cos(θ + Δθ) + Δx sin(θ + Δθ),  θ ← θ + Δθ   for each foot
    z₁ = (x_R − x_L) sin θ_L − (y_R − y_L) cos θ_L,   z₂ = (x_R − x_L) cos θ_L + (y_R − y_L) sin θ_L

Δx and Δy are components in the frame of the foot's stride, whose x axis points from one stance to the next; Δθ is the
change of heading between strides. z₁ is the distance across, to the right of the left foot, z₂ that along.

The state holds the place of the left foot relative to the right one instead of both places. Widths depend on it alone,
and its variance does not grow with the way; the variances of both places do, and single precision would lose their
small difference.

In addition to the paper's six states it contains the displacement of each foot since its last stance: the width of a
stride depends on three positions at three times, and their joint covariance is then known at the end of the stride.
(The covariance with a copy of the last stance position would have no inverse in stance.)

Source: Potter, Liu, Selamet and Kumaravelu, equations 1 to 6.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jgait.estimators.stride_width_ekf.params import WidthParams
from jgait.filtering import Belief, Covariance, Model
from jgait.types import SIDES, Flags, Values


class WidthState(NamedTuple):
    """Equation 1 with the left foot's place from the right one [m], headings from x to y [rad], and displacement of
    each foot since its last stance [m].
    """

    x_right: Values
    y_right: Values
    heading_right: Values
    apart_x: Values
    apart_y: Values
    heading_left: Values
    moved_x_right: Values
    moved_y_right: Values
    moved_x_left: Values
    moved_y_left: Values


class PathControl(NamedTuple):
    """Movement of one foot over an interval within one of its strides; equation 2."""

    dx: Values  #: displacement along the stride [m].
    dy: Values  #: displacement to the left of the stride [m].
    turn: Values  #: change of heading at the start of the interval [rad]; not 0 only after a stance.
    way: Values  #: length of the path [m].
    leaves: Flags  #: 1 where the interval begins at the middle of a stance, else 0.
    lost: Values = 0.0  #: variance of what is not known of the movement, because samples are lost [m²].


class WidthControl(NamedTuple):
    """Movements of both feet over an interval."""

    right: PathControl
    left: PathControl


class WidthObservation(NamedTuple):
    """Equation 6 [m]: distance across, range plus offset, and distance along, expected 0 while the feet pass."""

    across: Values
    along: Values


def transition(params: WidthParams, state: WidthState, control: WidthControl, dt: Values) -> WidthState:
    """Equation 3."""
    del params, dt
    moved: dict[str, Values] = {}
    for side, foot in zip(SIDES, control, strict=True):
        heading = getattr(state, f"heading_{side}") + foot.turn
        s, c = jnp.sin(heading), jnp.cos(heading)
        moved[f"heading_{side}"] = heading
        for axis, way in (("x", foot.dx * c - foot.dy * s), ("y", foot.dy * c + foot.dx * s)):
            since = f"moved_{axis}_{side}"
            moved |= {since: (1.0 - foot.leaves) * getattr(state, since) + way, f"{axis}_{side}": way}
    for axis in ("x", "y"):
        right, left = moved.pop(f"{axis}_right"), moved.pop(f"{axis}_left")
        moved[f"{axis}_right"] = getattr(state, f"{axis}_right") + right
        moved[f"apart_{axis}"] = getattr(state, f"apart_{axis}") + left - right
    return WidthState(**moved)


def transition_noise(params: WidthParams, state: WidthState, control: WidthControl, dt: Values) -> Covariance:
    """V R Vᵀ of equation 4: noise of Δx and Δy grows with the path; noise of Δθ is added once a stride. While samples
    are lost, the heading is not known either, by the variance of the movement [m²] up to 0.25 rad².
    """

    def moved(errors: Array) -> Array:
        right, left = (
            foot._replace(dx=foot.dx + x, dy=foot.dy + y, turn=foot.turn + turn)
            for foot, (x, y, turn) in zip(control, (errors[:3], errors[3:]), strict=True)
        )
        return jnp.stack(transition(params, state, WidthControl(right, left), dt))

    variances = []
    for foot in control:
        shift = params.position_noise**2 * foot.way + foot.lost
        heading = params.heading_noise**2 + params.turn_noise**2 * foot.turn**2
        variances += [shift, shift, foot.leaves * heading]
    V = jax.jacfwd(moved)(jnp.zeros(6, state.heading_right.dtype))
    lost = {f"heading_{side}": jnp.minimum(foot.lost, 0.25) for side, foot in zip(SIDES, control, strict=True)}
    more = jnp.stack([lost.get(name, jnp.zeros_like(V[0, 0])) for name in WidthState._fields])
    Q = jnp.sum(V[:, None] * V[None] * jnp.stack(variances)[None, None], axis=2)
    return Covariance.from_dense(Q + jnp.diag(more), state)


def between(state: WidthState) -> WidthObservation:
    """Equation 6: from the left foot to the right one, across and along the left foot's heading [m]."""
    x, y = state.apart_x, state.apart_y
    s, c = jnp.sin(state.heading_left), jnp.cos(state.heading_left)
    return WidthObservation(y * c - x * s, -x * c - y * s)


def observation(params: WidthParams, state: WidthState, control: WidthControl) -> WidthObservation:
    """Equation 6."""
    del params, control
    return between(state)


def observation_noise(params: WidthParams, state: WidthState, control: WidthControl) -> WidthObservation:
    """The paper's Q: variances of the range and of the distance along at a passing."""
    del state, control
    return WidthObservation(params.range_noise**2, params.passing_noise**2)


def initial(params: WidthParams) -> Belief:
    """Both feet head along the x axis; `start_belief` gives the belief of a recording."""
    return start_belief(params, 0.0, 0.0)


def start_belief(p: WidthParams, heading_right: Values, heading_left: Values) -> Belief:
    """The belief before the first interval: the right foot at the origin, the left foot beside it, headings [rad].

    The standard deviations of the right foot are about 0, since it defines the world frame.
    """
    zero = jnp.zeros_like(jnp.asarray(heading_right) + heading_left + p.start_width)
    s, c = jnp.sin(heading_right + zero), jnp.cos(heading_right + zero)
    x, y = -p.start_width * s, p.start_width * c
    mean = (zero, zero, heading_right + zero, x, y, heading_left + zero, zero, zero, zero, zero)
    side, ahead, known = p.start_across**2, p.start_along**2, 1e-6
    apart = side * s * s + ahead * c * c, side * c * c + ahead * s * s
    variances = WidthState(known, known, known, *apart, p.start_heading**2, zero, zero, zero, zero)
    cov = Covariance.from_variances(variances).with_entries({("apart_x", "apart_y"): (ahead - side) * s * c})
    return Belief(WidthState(*mean), cov)


MODEL = Model(initial, transition, transition_noise, observation, observation_noise)
"""The model with the paper's misprints corrected, the default."""
