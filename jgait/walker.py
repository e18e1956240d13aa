"""A two-link leg that walks: both legs of one person on a straight line, with exact truth.

Where each foot stands, how the hip moves forward and how each knee bends are smooth functions of time; the thigh
takes the angle that puts the ankle there, and the hip rides on the leg that bears. So a planted ankle stays where
it is, the hip advances because the leg turns over it, and nothing is integrated or differenced: what sensors read
comes from derivatives by `jax.jvp`. Every function of time is at least twice continuously differentiable.

The world is x forward, y up, z to the right; a positive turn about z swings the distal end of a segment forward.
Sensor axes at zero angle and without mounting error are those of the world.

Source: the protocol is that of Bennett, Jafari and Gans, "An extended Kalman filter to estimate human gait
parameters and walking distance", sections IV and V: 3 to 4 m straight, starting and ending with feet parallel.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jgait.sensors import DEGREE

SEGMENTS = ("thigh_right", "shank_right", "thigh_left", "shank_left")


class _Wave(NamedTuple):
    """A bump once a stride: exp(sharpness (cos(turn - 2 pi phase) - 1))."""

    phase: float
    sharpness: float


LOADING_WAVE = _Wave(phase=0.14, sharpness=5.0)
SWING_WAVE = _Wave(phase=0.69, sharpness=2.8)
"""Where in the stride, from this foot's contact, the knee bends under load and in swing, and for how long."""


class Person(NamedTuple):
    """Who walks, and how; every field is a scalar, so that populations stack and gradients flow.

    Attributes:
        thigh_length: hip to knee [m].
        shank_length: knee to ankle [m].
        ankle_height: ankle above the sole [m].
        ball_length: ankle to the ball of the foot, along the sole [m].
        heel_length: ankle to the back of the heel, along the sole [m].
        step_length: from one foothold to the next of the other foot [m].
        step_time: from one foothold to the next of the other foot [s].
        steps: how many step lengths are walked; a whole number.
        double_support: share of the step time in which weight passes from foot to foot [1].
        knee_stance: least knee flexion in stance [rad].
        knee_loading: flexion that taking the load adds [rad].
        knee_swing: flexion that swing adds [rad].
        toe_up: pitch of the foot as it lands on its heel [rad].
        heel_up: pitch of the foot at the end of push-off [rad].
        hip_ahead: how far roll-over carries the hip ahead of the middle of the feet [m].
        roll_over: scales `toe_up`, `heel_up` and `hip_ahead` [1]; 0 keeps the planted ankle exactly still.
        standing_hip: hip flexion while standing [rad].
        standing_knee: knee flexion while standing [rad].
        right_first: 1 if the right foot takes the first step, 0 if the left.
        quiet_before: quiet standing before anything moves [s].
        quiet_after: quiet standing at the end [s].
        thigh_sensor: distance of the thigh sensor from the hip, as a share of the thigh [1].
        shank_sensor: distance of the shank sensor from the knee, as a share of the shank [1].
    """

    thigh_length: Any = 0.245 * 1.75
    shank_length: Any = 0.246 * 1.75
    ankle_height: Any = 0.039 * 1.75
    ball_length: Any = 0.080 * 1.75
    heel_length: Any = 0.030 * 1.75
    step_length: Any = 0.62
    step_time: Any = 0.51
    steps: Any = 6.0
    double_support: Any = 0.2
    knee_stance: Any = 5.0 * DEGREE
    knee_loading: Any = 11.0 * DEGREE
    knee_swing: Any = 54.0 * DEGREE
    toe_up: Any = 18.0 * DEGREE
    heel_up: Any = 40.0 * DEGREE
    hip_ahead: Any = 0.055
    roll_over: Any = 1.0
    standing_hip: Any = 2.0 * DEGREE
    standing_knee: Any = 4.0 * DEGREE
    right_first: Any = 1.0
    quiet_before: Any = 3.0
    quiet_after: Any = 1.5
    thigh_sensor: Any = 0.5
    shank_sensor: Any = 0.5


class LegPose(NamedTuple):
    """One leg at one instant.

    Attributes:
        hip: thigh from the downward vertical [rad], flexion positive.
        knee: knee flexion [rad].
        x: ankle ahead of the hip [m].
        y: ankle above the hip [m].
        rise: how far the pitch of the foot lifts the ankle off its standing height while the foot bears [m].
    """

    hip: Any
    knee: Any
    x: Any
    y: Any
    rise: Any


def _smooth(u: Any) -> Any:
    """A step from 0 to 1 over u in [0, 1] whose first three derivatives vanish at both ends."""
    u = jnp.clip(u, 0.0, 1.0)
    return u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)


def _smooth_ramp(u: Any) -> Any:
    """The integral of `_smooth`: at rest before 0, speed 1 after 1."""
    c = jnp.clip(u, 0.0, 1.0)
    return c**5 * (7.0 - 14.0 * c + 10.0 * c**2 - 2.5 * c**3) + jnp.maximum(u - 1.0, 0.0)


def forward_kinematics(person: Person, hip: Any, knee: Any) -> tuple[Any, Any]:
    """Ankle relative to hip (x forward, y up) [m] from joint angles [rad].

    x = l1 sin(hip) + l2 sin(hip - knee),  y = -l1 cos(hip) - l2 cos(hip - knee)
    """
    shank = hip - knee
    x = person.thigh_length * jnp.sin(hip) + person.shank_length * jnp.sin(shank)
    y = -person.thigh_length * jnp.cos(hip) - person.shank_length * jnp.cos(shank)
    return x, y


def step_clock(person: Person, time: Any) -> Any:
    """Step times since the first step began [1]; the first heel rises half a step before that."""
    return (time - person.quiet_before) / person.step_time - 0.5


def hip_progress(person: Person, u: Any) -> Any:
    """How far the hip has come [m]: it gathers speed over the first step and comes to rest over the last."""
    p = person
    standing = forward_kinematics(p, p.standing_hip, p.standing_knee)[0]  # while walking, the feet forget the pose
    ahead = (p.roll_over * p.hip_ahead + standing) * (_smooth(u) - _smooth(u - p.steps))
    return p.step_length * (_smooth_ramp(u) - _smooth_ramp(u - p.steps)) + ahead


def knee_angle(person: Person, u: Any, leads: Any) -> Any:
    """Knee flexion [rad]: two waves a stride, of loading and of swing, that grow out of standing and fade into it."""
    p = person
    turn = jnp.pi * (u - (2.0 - leads))  # a stride is two steps; 0 where this foot takes over the weight
    loading = jnp.exp(LOADING_WAVE.sharpness * (jnp.cos(turn - 2.0 * jnp.pi * LOADING_WAVE.phase) - 1.0))
    swing = jnp.exp(SWING_WAVE.sharpness * (jnp.cos(turn - 2.0 * jnp.pi * SWING_WAVE.phase) - 1.0))
    curve = p.knee_stance + p.knee_loading * loading + p.knee_swing * swing
    closes = jnp.where(jnp.mod(p.steps, 2.0) < 0.5, leads, 1.0 - leads)
    begin = jnp.where(leads > 0.5, -0.1, 0.1)
    settle = jnp.where(closes > 0.5, 0.3, 0.0)
    window = _smooth((u - begin) / 0.9) - _smooth((u - p.steps - settle) / (1.0 - settle))
    return p.standing_knee + window * (curve - p.standing_knee)


def foot_progress(person: Person, u: Any, leads: Any) -> tuple[Any, Any]:
    """Ankle in the world: how far it has come [m], and how far its pitch lifts it [m] while the foot bears.

    Between two swings the foot stands: it lands on its heel and turns flat about it, and from mid-stance on it turns
    about its ball. Both carry the ankle forward.
    """
    p = person
    lift, land = -1.0 + 0.5 * p.double_support, -0.5 * p.double_support
    parity = 2.0 - leads
    step = parity + 2.0 * jnp.floor((u + 1.5 - parity) / 2.0)  # this foot's swing that is nearest in time
    v = u - step
    swings = (step > 0.5) & (step < p.steps + 1.5)
    origin = jnp.clip(step - 2.0, 0.0, p.steps)
    target = jnp.clip(step, 0.0, p.steps)
    tau = (v - lift) / (land - lift)
    gain, loss = 0.5, 0.3  # shares of swing in which the foot gathers and loses speed
    way = gain * _smooth_ramp(tau / gain) - loss * _smooth_ramp((tau - 1.0 + loss) / loss)
    progress = p.step_length * (origin + (target - origin) * way / (1.0 - 0.5 * (gain + loss)))
    pushes = jnp.where(swings, jnp.where(step > 1.5, 1.0, 0.5), 0.0)  # the first push-off carries half a step
    rocks = jnp.where(swings & (step < p.steps + 0.5), 1.0, 0.0)  # the last step ends flat
    heel_up = pushes * p.roll_over * p.heel_up * (_smooth((v + 1.45) / 0.9) - _smooth((v + 0.55) / 0.45))
    toe_up = rocks * p.roll_over * p.toe_up * (_smooth((v + 0.6) / (0.6 + land)) - _smooth((v - land) / 0.35))
    ball_x, ball_y = _turn_about(-heel_up, -p.ball_length, p.ankle_height)
    heel_x, heel_y = _turn_about(toe_up, p.heel_length, p.ankle_height)
    return progress + ball_x + heel_x, ball_y + heel_y


def _turn_about(angle: Any, x: Any, y: Any) -> tuple[Any, Any]:
    """How a point at (x, y) from the pivot moves when turned by an angle [rad] about it."""
    s, c = jnp.sin(angle), jnp.cos(angle) - 1.0
    return c * x - s * y, s * x + c * y


def leg_pose(person: Person, u: Any, leads: Any) -> LegPose:
    """One leg at `u` step times since the first step began.

    Where the foot is and how the knee bends are given, so the thigh is the angle that puts the ankle there:
    hip = arcsin(x / r) + arctan2(l2 sin(knee), l1 + l2 cos(knee)),  r^2 = l1^2 + l2^2 + 2 l1 l2 cos(knee)

    Args:
        person: who walks.
        u: step clock, see `step_clock`; a scalar.
        leads: 1 if this leg takes the first step, 0 if the other does.
    """
    p = person
    knee = knee_angle(p, u, leads)
    progress, rise = foot_progress(p, u, leads)
    x = progress - hip_progress(p, u) + forward_kinematics(p, p.standing_hip, p.standing_knee)[0]
    a, b = p.thigh_length, p.shank_length
    reach = jnp.sqrt(a * a + b * b + 2.0 * a * b * jnp.cos(knee))
    hip = jnp.arcsin(x / reach) + jnp.arctan2(b * jnp.sin(knee), a + b * jnp.cos(knee))
    return LegPose(hip, knee, x, -jnp.sqrt(reach * reach - x * x), rise)


def body_pose(person: Person, u: Any) -> tuple[Any, Any, LegPose]:
    """Hip progress [m], hip height above a standing ankle [m], and both legs, (right, left) stacked in each field.

    The hip rides on the leg that bears; weight passes to the next foot over `double_support`, in which the ankles
    take up the difference of the two legs' heights.
    """
    p = person
    right = jnp.where(jnp.asarray(p.right_first, u.dtype) > 0.5, jnp.ones_like(u), jnp.zeros_like(u))
    leads = jnp.stack([right, 1.0 - right])
    legs = jax.vmap(leg_pose, in_axes=(None, None, 0))(p, u, leads)
    passing = jnp.clip(jnp.round(u), 1.0, p.steps)  # the step whose landing is nearest in time
    share = _smooth((u - passing) / p.double_support + 0.5)
    to_leading = jnp.mod(passing, 2.0) > 0.5
    bears = jnp.where((leads > 0.5) == to_leading, share, 1.0 - share)
    return hip_progress(p, u), jnp.sum(bears * (legs.rise - legs.y)), legs


class Moment(NamedTuple):
    """Everything at one instant, in world coordinates [m] and angles from the downward vertical [rad].

    Attributes:
        hip_x: how far the hip has come.
        hip_y: hip above a standing ankle.
        legs: each field (2,), right and left.
        angle: (4,) of the segments, in the order of `SEGMENTS`.
        sensor_x: (4,) sensor on the segment, forward.
        sensor_y: (4,) sensor on the segment, up.
    """

    hip_x: Any
    hip_y: Any
    legs: LegPose
    angle: Any
    sensor_x: Any
    sensor_y: Any


def moment(person: Person, time: Any) -> Moment:
    """The walk at one time [s], a scalar."""
    p = person
    x, y, legs = body_pose(p, step_clock(p, time))
    thigh, shank = legs.hip, legs.hip - legs.knee
    thigh_at, shank_at = p.thigh_sensor * p.thigh_length, p.shank_sensor * p.shank_length
    sensor_x = (
        x + thigh_at * jnp.sin(thigh),
        x + p.thigh_length * jnp.sin(thigh) + shank_at * jnp.sin(shank),
    )
    sensor_y = (
        y - thigh_at * jnp.cos(thigh),
        y - p.thigh_length * jnp.cos(thigh) - shank_at * jnp.cos(shank),
    )
    by_segment = (jnp.stack(pair, axis=1).reshape(4) for pair in ((thigh, shank), sensor_x, sensor_y))
    return Moment(x, y, legs, *by_segment)


def motion(person: Person, time: Any) -> tuple[Moment, Moment, Moment]:
    """The walk, its rates and its accelerations at times (T,) [s], exact by forward-mode differentiation."""

    def rates(at: Any) -> tuple[Moment, Moment]:
        return jax.jvp(lambda t: moment(person, t), (at,), (jnp.ones_like(at),))

    def accelerations(at: Any) -> tuple[Moment, Moment, Moment]:
        (value, rate), (_, acceleration) = jax.jvp(rates, (at,), (jnp.ones_like(at),))
        return value, rate, acceleration

    return jax.vmap(accelerations)(time)
