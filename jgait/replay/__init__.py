"""Motion capture played again: joint centres become what perfect or erring sensors on the body would have felt.

A smoothing spline through each joint centre gives its place, velocity and acceleration at any time; the segments'
axes are built from the points and differentiated exactly. So a real walk gives signals without noise, soft tissue or
misplacement, at any rate, with known truth. World: z up, the other two axes are the laboratory's; metres, seconds.

What the points cannot tell: the turn of thigh and shank about their long axes is that of the pelvis about the
vertical, the pelvis is level unless its markers are given, and impacts faster than the spline's cut-off are lost.
"""

from jgait.replay.body import JointCentres, LegCentres, PelvisMarkers, Replay, body_motion, frames
from jgait.replay.spline import CUTOFF_HZ, MAX_GAP, Trajectory, acceleration_noise, covered, evaluate, smooth
from jgait.replay.wear import from_walk, mount, replay

__all__ = [
    "CUTOFF_HZ", "MAX_GAP", "JointCentres", "LegCentres", "PelvisMarkers", "Replay", "Trajectory",
    "acceleration_noise", "body_motion", "covered", "evaluate", "frames", "from_walk", "mount", "replay", "smooth",
]  # fmt: skip
