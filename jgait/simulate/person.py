"""Body lengths and gait parameters of a person, each one scalar with its unit."""

from typing import NamedTuple

from jgait.types import Values

DEGREE = 0.017453292519943295


class Body(NamedTuple):
    """Lengths of the lower body [m]; the defaults are those of a person of 1.75 m.

    Attributes:
        thigh_length: hip to knee.
        shank_length: knee to ankle.
        hip_width: between the hip joint centres.
        ankle_height: ankle above the sole.
        heel_length: from below the ankle back to the edge of the heel.
        ball_length: from below the ankle forward to the ball of the foot, about which it rolls off.
        toe_length: from the ball to the tip of the toes.
        back_height: from the middle of the hips up to the fifth lumbar vertebra.
        back_depth: from the middle of the hips back to the skin over it; half of the pelvis' depth.
    """

    thigh_length: Values = 0.245 * 1.75
    shank_length: Values = 0.246 * 1.75
    hip_width: Values = 0.100 * 1.75
    ankle_height: Values = 0.039 * 1.75
    heel_length: Values = 0.030 * 1.75
    ball_length: Values = 0.078 * 1.75
    toe_length: Values = 0.044 * 1.75
    back_height: Values = 0.055 * 1.75
    back_depth: Values = 0.062 * 1.75


class Gait(NamedTuple):
    """How a person walks; fractions are of the stride from a foot's initial contact.

    Attributes:
        stride_length: from one foothold of a foot to its next [m].
        stride_time: from one initial contact of a foot to its next [s].
        stance_fraction: how much of the stride a foot is on the ground; the tip of its toes begins to lift 5 % of
            a stride (`feet.LINGER`) before that is over, by a few millimetres [1].
        step_width: between the lines on which the two feet walk [m].
        toe_out: how far the feet point outwards [rad].
        toe_up: pitch of the foot at initial contact [rad].
        heel_up: pitch of the foot at its steepest, just after the toes have left [rad].
        foot_flat: when the sole has come down [1].
        heel_off: when the heel begins to rise [1].
        swing_lift: how far the foot is lifted in mid swing, beside what its pitch does [m].
        landing_speed: share of its speed that the foot keeps until the ground stops it [1].
        knee_stance: least knee flexion [rad]; the pelvis is as high as that allows.
        pelvis_rise: from the lowest to the highest position of the pelvis [m].
        pelvis_sway: how far the pelvis moves to the side of the foot that bears [m].
        pelvis_surge: how far the pelvis runs ahead of constant speed and falls behind [m].
        pelvis_rotation: how far the pelvis turns with the leading leg, to each side [rad].
        pelvis_drop: how far it drops on the side of the swinging leg [rad].
        pelvis_nod: how far it tilts forward and back, twice a stride [rad].
        pelvis_shock: how far landing shakes the pelvis down [m].
        hip_ahead: how far the hips are ahead of the middle of the feet when a foot lands [m].
        standing_hip: hip flexion when standing [rad].
        standing_knee: knee flexion when standing [rad].
        length_asymmetry: (right − left) / (right + left) of the step lengths [1].
        time_asymmetry: (right − left) / (right + left) of the step times [1].
        length_variability: standard deviation of the step length over its mean [1].
        time_variability: standard deviation of the step time over its mean [1].
        width_variability: standard deviation of where a foot lands sideways [m].
        steps: how many step lengths are walked, after which the other foot closes up; a whole number.
        right_first: 1 if the right foot takes the first step, 0 if the left.
        quiet_before: quiet standing before anything moves [s].
        quiet_after: quiet standing at the end [s].
    """

    stride_length: Values = 1.32
    stride_time: Values = 1.06
    stance_fraction: Values = 0.62
    step_width: Values = 0.09
    toe_out: Values = 6.0 * DEGREE
    toe_up: Values = 35.0 * DEGREE
    heel_up: Values = 77.0 * DEGREE
    foot_flat: Values = 0.09
    heel_off: Values = 0.30
    swing_lift: Values = 0.031
    landing_speed: Values = 0.38
    knee_stance: Values = 5.0 * DEGREE
    pelvis_rise: Values = 0.042
    pelvis_sway: Values = 0.02
    pelvis_surge: Values = 0.025
    pelvis_rotation: Values = 4.0 * DEGREE
    pelvis_drop: Values = 4.0 * DEGREE
    pelvis_nod: Values = 1.5 * DEGREE
    pelvis_shock: Values = 0.0015
    hip_ahead: Values = 0.045
    standing_hip: Values = 2.0 * DEGREE
    standing_knee: Values = 4.0 * DEGREE
    length_asymmetry: Values = 0.0
    time_asymmetry: Values = 0.0
    length_variability: Values = 0.0
    time_variability: Values = 0.0
    width_variability: Values = 0.0
    steps: Values = 6.0
    right_first: Values = 1.0
    quiet_before: Values = 3.0
    quiet_after: Values = 1.5


class Person(NamedTuple):
    """Who walks, and how.

    Attributes:
        body: the lengths.
        gait: the manner.
    """

    body: Body = Body()
    gait: Gait = Gait()
