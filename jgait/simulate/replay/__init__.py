"""Motion capture replayed: from joint centres to the readings of perfect or imperfect sensors on the body.

A smoothing spline through each joint centre gives its place, velocity and acceleration at any time; the segments'
axes are built from the points and differentiated exactly. So a real walk gives signals without noise, soft tissue or
misplacement, at any rate, with known truth. World: z up, the other two axes are the laboratory's; metres, seconds.

The points do not determine turns about long axes: the thigh's is the pelvis' about the vertical, the shank's is the
foot's, less the toe-out; the pelvis is level unless its markers are given. Impacts faster than the splines' cut-off are
lost. At both ends of a recording, and at the edges of long gaps, a spline knows one side only: within about 1 / cut-off
of an end in full motion accelerations err by up to 2 m/s².

On the trial of `neura_sparse` (straight parts), fitting only each worn sensor's axis, sagittal rates correlate with the
gyroscopes by 0.96 and 0.94 (thigh right, left), 0.994 to 0.996 (shank, ankle) and 0.99 (foot). Those joint centres are
smooth already: cut-offs from 10 to 25 Hz give the same. With white noise of 1 mm added, accelerations err by 0.6 m/s²
at 10 Hz (foot 0.9), and by 0.13 to 0.37 m/s² with `noise=1e-3`, which chose 3 to 5 Hz.
"""

from jgait.simulate.replay.body import JointCentres, LegCentres, PelvisMarkers, Replay, body_motion, frames
from jgait.simulate.replay.spline import CUTOFF_HZ, MAX_GAP, Trajectory, acceleration_noise, covered, evaluate, smooth
from jgait.simulate.replay.wear import from_walk, mount, replay

__all__ = [
    "CUTOFF_HZ", "MAX_GAP", "JointCentres", "LegCentres", "PelvisMarkers", "Replay", "Trajectory",
    "acceleration_noise", "body_motion", "covered", "evaluate", "frames", "from_walk", "mount", "replay", "smooth",
]  # fmt: skip
