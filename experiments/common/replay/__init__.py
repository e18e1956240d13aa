"""Motion capture replayed: the readings of perfect virtual sensors, from joint centres.

A smoothing spline through each joint centre gives its position, velocity and acceleration at any time; the segments'
axes are built from the points and differentiated exactly. So a real walk gives signals without noise, soft tissue or
misplacement, at any rate, with known truth. World: z up, the other two axes as in the laboratory; metres, seconds.

The points do not determine rotations about long axes: the thigh has the yaw of the pelvis, the shank has the yaw of the
foot minus the toe-out; the pelvis is level unless its markers are given. Impacts faster than the splines' cut-off are
lost. At both ends of a recording, and at the edges of long gaps, a spline has data on one side only: within about
1 / cut-off of an end in full motion the error of accelerations is up to 2 m/s².

On the trial of `neura_sparse` (straight parts), fitting only each worn sensor's axis, sagittal rates correlate with the
gyroscopes by 0.96 and 0.94 (thigh right, left), 0.994 to 0.996 (shank, ankle) and 0.99 (foot). These joint centres are
already smooth: cut-offs from 10 to 25 Hz give the same. With white noise of 1 mm added, the error of accelerations is
0.6 m/s² at 10 Hz (foot 0.9), and 0.13 to 0.37 m/s² with `noise=1e-3`, which chose 3 to 5 Hz.
"""

from experiments.common.replay.body import JointCentres, LegCentres, PelvisMarkers, Replay, body_motion, frames
from experiments.common.replay.capture import joint_centres
from experiments.common.replay.spline import CUTOFF_HZ, MAX_GAP, Trajectory, covered, evaluate, smooth
from experiments.common.replay.wear import from_walk, mount, replay

__all__ = [
    "CUTOFF_HZ", "MAX_GAP", "JointCentres", "LegCentres", "PelvisMarkers", "Replay", "Trajectory",
    "body_motion", "covered", "evaluate", "frames", "from_walk", "joint_centres", "mount", "replay", "smooth",
]  # fmt: skip
