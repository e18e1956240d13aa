"""Body lengths and gait parameters of a person, each one scalar with its unit."""

import json
from pathlib import Path
from typing import Any, NamedTuple

from jgait.notes import record
from jgait.types import Values

DEGREE = 0.017453292519943295
"""One degree [rad]."""

TABLES: dict[str, Any] = json.loads(Path(__file__).with_name("movement.json").read_text(encoding="utf-8"))
"""Numbers of the movement of recorded people, whose file names its source: tables of `shapes`, gait of `RECORDED`,
and powers of the stride (`population.manner`). `experiments.people.shapes` derives them."""


@record
class Body(NamedTuple):
    """Lengths of the lower body [m]; the defaults are those of a person of 1.75 m."""

    thigh_length: Values = 0.245 * 1.75  #: hip to knee.
    shank_length: Values = 0.246 * 1.75  #: knee to ankle.
    hip_width: Values = 0.100 * 1.75  #: between the hip joint centres.
    ankle_height: Values = 0.039 * 1.75  #: ankle above the sole.
    heel_length: Values = 0.030 * 1.75  #: from below the ankle back to the edge of the heel.
    #: from below the ankle forward to the ball of the foot, about which the foot rolls off.
    ball_length: Values = 0.078 * 1.75
    toe_length: Values = 0.044 * 1.75  #: from the ball to the tip of the toes.
    back_height: Values = 0.055 * 1.75  #: from the middle of the hips up to the fifth lumbar vertebra.
    #: from the middle of the hips back to the skin over this vertebra; half of the pelvis' depth.
    back_depth: Values = 0.062 * 1.75

    @property
    def height(self) -> Values:
        """Stature of a person of average proportions with these legs [m]."""
        return (self.ankle_height + self.shank_length + self.thigh_length) / (0.039 + 0.246 + 0.245)

    @property
    def sensor_height(self) -> Values:
        """Height of a sensor over this vertebra above the ground, when standing upright [m]."""
        return self.ankle_height + self.shank_length + self.thigh_length + self.back_height


@record
class Gait(NamedTuple):
    """The gait of a person; fractions are shares of the stride, from the initial contact of a foot."""

    stride_length: Values = 1.32  #: distance from one foothold of a foot to the next foothold of the same foot [m].
    stride_time: Values = 1.06  #: time from one initial contact of a foot to the next of the same foot [s].
    #: share of the stride in which a foot is on the ground; the tip of its toes begins to lift 5 % of a stride
    #: (`feet.LINGER`) before the end of stance, by a few millimetres; below a half: running [1].
    stance_fraction: Values = 0.62
    step_width: Values = 0.09  #: distance between the lines on which the two feet walk [m].
    toe_out: Values = 6.0 * DEGREE  #: angle by which the feet point outwards [rad].
    toe_up: Values = 35.0 * DEGREE  #: pitch of the foot at initial contact [rad].
    heel_up: Values = 77.0 * DEGREE  #: largest pitch of the foot, just after toe-off [rad].
    foot_flat: Values = 0.09  #: end of the foot's rotation about the heel, when the sole is on the ground [1].
    heel_off: Values = 0.30  #: start of the heel's rise [1].
    swing_lift: Values = 0.031  #: lift of the foot in mid swing, in addition to the effect of its pitch [m].
    landing_speed: Values = 0.38  #: share of its speed that the foot keeps until the ground stops it [1].
    knee_stance: Values = 5.0 * DEGREE  #: least knee flexion [rad]; it limits the height of the pelvis.
    #: from the lowest to the highest position of the pelvis, in mid stance [m]; negative: in mid stance it is lowest,
    #: as in running.
    pelvis_rise: Values = 0.042
    pelvis_sway: Values = 0.02  #: amplitude of the pelvis' motion to the side of the stance leg [m].
    pelvis_surge: Values = 0.025  #: amplitude of the pelvis' forward motion about constant speed [m].
    pelvis_rotation: Values = 4.0 * DEGREE  #: amplitude of the pelvis' yaw with the leading leg [rad].
    pelvis_drop: Values = 4.0 * DEGREE  #: amplitude of the pelvis' drop on the side of the swing leg [rad].
    pelvis_nod: Values = 1.5 * DEGREE  #: amplitude of the pelvis' forward and backward tilt, twice a stride [rad].
    pelvis_shock: Values = 0.0015  #: downward motion of the pelvis from the impact at landing [m].
    #: time by which the pelvis rises, surges and nods later than by the rules of walking [steps]; counts where
    #: `recorded` is 0.
    pelvis_lag: Values = 0.0
    #: 0: feet and pelvis move by simple rules; 1: as those of recorded people do, see `RECORDED` [1].
    recorded: Values = 0.0
    #: coordinate of the person's style of movement on the first of the directions in which recorded people differ most,
    #: in standard deviations (see `shapes`); 0: their mean; counts where `recorded` is 1 [1].
    style_1: Values = 0.0
    style_2: Values = 0.0  #: the same on the second direction; as the following two.
    style_3: Values = 0.0  #: the same on the third direction.
    style_4: Values = 0.0  #: the same on the fourth direction.
    #: motion of sensors on thighs, shanks and feet over the bone, and their turns out of the plane of the leg, over
    #: those of recorded people; 0: none [1].
    soft_tissue: Values = 0.0
    hip_ahead: Values = 0.045  #: distance of the hips ahead of the middle of the feet at initial contact [m].
    standing_hip: Values = 2.0 * DEGREE  #: hip flexion in standing [rad].
    standing_knee: Values = 4.0 * DEGREE  #: knee flexion in standing [rad].
    length_asymmetry: Values = 0.0  #: (right − left) / (right + left) of the step lengths [1].
    time_asymmetry: Values = 0.0  #: (right − left) / (right + left) of the step times [1].
    #: share by which the right leg bends less in swing; negative: the left leg. Its heel rises less, its toes are less
    #: up at landing, and it swings outwards by up to 7 cm [1].
    stiff: Values = 0.0
    length_variability: Values = 0.0  #: standard deviation of the step length over its mean [1].
    time_variability: Values = 0.0  #: standard deviation of the step time over its mean [1].
    width_variability: Values = 0.0  #: standard deviation of the sideways position of footholds [m].
    #: standard deviation of the foot's pitch at landing and at toe-off over its mean [1].
    pitch_variability: Values = 0.0
    persistence: Values = 0.0  #: correlation of the lengths of one step and the next, and of their times [1].
    steps: Values = 6.0  #: number of steps before the closing step of the other foot; a whole number.
    right_first: Values = 1.0  #: 1 if the right foot takes the first step, 0 if the left.
    quiet_before: Values = 3.0  #: duration of quiet standing before the walk [s].
    quiet_after: Values = 1.5  #: duration of quiet standing after the walk [s].


RECORDED = Gait(
    pelvis_rise=0.0323, pelvis_sway=0.028, pelvis_surge=0.011, pelvis_rotation=3.2 * DEGREE, pelvis_drop=2.5 * DEGREE,
    pelvis_nod=0.35 * DEGREE, pelvis_shock=0.0, recorded=1.0, **TABLES["gait"],
)  # fmt: skip
"""The mean gait of recorded people, by `experiments.people.shapes`."""


@record
class Person(NamedTuple):
    """A person: lengths of the lower body, and parameters of the gait."""

    body: Body = Body()
    gait: Gait = Gait()


def evenly(person: Person, steps: int, **others: Values) -> Person:
    """The person with a number of steps that do not vary; `others`: other fields of the gait."""
    even = dict.fromkeys((f"{name}_variability" for name in ("length", "time", "width", "pitch")), 0.0)
    return Person(person.body, person.gait._replace(**(even | {"steps": float(steps)} | others)))
