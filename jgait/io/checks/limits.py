"""Every threshold of the checks, with its unit. Those without another word were chosen outside of what undamaged
recordings, public and simulated, reach; the number behind it is what they reach.
"""

import numpy as np

from jgait.geometry.vectors import GRAVITY

# --- what is compared ---

WINDOW_S, LONGEST_S, SHORTEST_S = 2.24, 60.0, 5.0
"""[s] Length of a window, two strides of usual walking; part of a recording that is compared; shortest recording in
which delays and paces are."""

LONG_GAP_S = 0.1  # [s] shortest gap whose samples do not count; shorter ones are bridged
SLOWEST_HZ = 10.0  # [Hz] least sampling rate at which sensors are compared: a stride has ten samples
ACTIVE = 0.5  # [1] share of the fastest window's mean square rate above which a window is walking
TRUNK = ("pelvis", "lower", "waist")  # first words of the placements of the trunk, which turns little

# --- range, stuck and clipped readings ---

READINGS = {"gyr": 100.0, "acc": 4000.0}
"""[rad/s], [m/s²] Largest reading. No wearable gyroscope reads above 4000 deg/s, no accelerometer above 400 g."""

MOST_IMPOSSIBLE, MOST_ZEROS = 0.01, 0.5
"""[1] Largest share of impossible samples that is masked: with more, the unit is wrong; and of rows of zeros: with more
they are written on purpose."""

PLACEHOLDERS = (-999.0, 999.0, -9999.0, 9999.0, -99999.0, 99999.0)
"""Numbers that programs write for a missing value, in the unit of the file."""

ALONE = 4.0
"""[1] Size of a number that is repeated over that of all other numbers, from which on it stands for a missing value."""

LEAST_PLACEHOLDER = {"gyr": 10.0, "acc": 50.0}
"""[rad/s], [m/s²] Least size of such a number: 999 mg and 999 mdeg/s are readings."""

SPIKE = {"gyr": (24.0, 10.0), "acc": (60.0, 90.0)}
"""[rad/s], [m/s²] Least distance of a spike from the median of five samples, at the foot (14.4, 162) and elsewhere
(4.7, 49)."""

CALM_AROUND, IMPACT, AROUND = 2.5, 0.01, 6
"""[1] Least ratio of a spike to other changes up to `AROUND` samples away; [rad/s per m/s²] largest change of the rate
around a spike of an accelerometer: impacts turn the sensor as well, by 0.02 at least."""

WRAP_STEP, WRAP_EDGE, WRAPS, MOST_WRAPPED = 1.6, 0.97, 4, 0.3
"""[1] Change of a wrap, and share of the range that is reached on both sides, both over the range; least number;
largest share of samples beyond the range in a channel that is continued, chosen: swings last less."""

RANGES = {"gyr": np.deg2rad([125.0, 245.0, 250.0, 300.0, 400.0, 450.0, 500.0, 900.0, 1000.0, 1200.0, 2000.0]),
          "acc": GRAVITY * np.array([2.0, 4.0, 6.0, 8.0, 16.0])}  # fmt: skip
"""Ranges of common gyroscopes [rad/s] and accelerometers [m/s²]."""

FROZEN_RUN, FROZEN_S, STOPPED_S, STOPPED = 8, 0.05, 1.0, 10.0
"""[samples], [s] Shortest time in which a sensor repeats its reading (4 of gyroscopes, 22 of coarse accelerometers that
do not turn); [s], [1] shortest one to the end of a recording, and its length over that of other such times, as at
rest."""

FROZEN_STEPS, FROZEN_CHANGE, TURNING = 10.0, {"gyr": 0.1, "acc": 1.0}, 0.3
"""[steps of the resolution], [rad/s, m/s²] Least change at the end of that time; [rad/s] mean rate in it with which an
accelerometer cannot repeat its reading."""

BY_CHANCE, AS_ELSEWHERE = 1e-24, 0.25
"""[1] Largest probability of so many repeats in a row, if they were independent, by those elsewhere (1e-19 of an
accelerometer in steps of 0.1 g), and least change of the other axes meanwhile over their mean, of an axis that is
stuck; the latter chosen."""

COARSE = 0.04 * GRAVITY
"""[m/s²] Step of an accelerometer from which on its readings repeat at rest and results change; in steps of 0.03 g,
distances are within 0.5 %, of 0.05 g within 4 %."""

REPEATS, HELD, LEAST_HZ = 0.4, 0.12, 45.0
"""[1] Share of readings that repeat the one before (.04), and of samples at which one sensor of several does, from
which on it is slower than its file; [Hz] least rate of new readings, below which steps come out wrong."""

CLIP_RUN, CLIP_FLOOR, CLIP_EDGE = 3, {"gyr": 1.0, "acc": 1.5 * GRAVITY}, 5.0
"""[samples] Shortest run at the extreme of a clipped channel; [rad/s, m/s²] smallest clipped value; [steps] least
change beside the run in a coarse sensor."""

HELD_RANGE_S, STUCK_RANGE_S, FEWEST_READINGS, FEET_MOVE = 0.3, 5.0, 10, 1.0
"""[s] Longest time of one range between moving feet without a gap, and with gaps, of at least so many readings; [rad/s]
mean rate of the faster foot in it."""

# --- gravity and units of one sensor ---

TURNED_HZ, TILT_HZ = 50.0, 20.0
"""[Hz] Least rate of the averages that are turned; least sampling rate: between slower samples legs turn too far."""

FASTEST_WINDOW, MOVING_TRUNK = 1.0, 0.15
"""[rad/s] Least rms rate of a window of walking in which the direction of gravity turns enough, of legs and trunk."""

AGREEING = {"foot": (0.89, 1.11), "ankle": (0.91, 1.10), "shank": (0.93, 1.09), "thigh": (0.91, 1.08),
            "pelvis": (0.90, 1.10), "lower": (0.90, 1.10)}  # fmt: skip
"""[1] Size of the turned mean over gravity (foot 0.922 to 1.094, shank 0.961 to 1.075, thigh 0.930 to 1.060, trunk
0.956 to 1.035)."""

FEW_WINDOWS, UNDONE = 0.12, 0.06
"""[1] What `AGREEING` is widened by, over √(windows); difference from gravity with a likely cause undone."""

SLOW_GYR, SHAKEN = 0.3, 1.0
"""[rad/s] 99th percentile of the rate of a leg's sensor (2.1) and [m/s²] spread of its force in walking."""

STANDING_S, STILL, BIAS_S, BESIDE_S, STANDINGS = 0.5, (0.05, 1.0), 1.5, 5.0, 8
"""[s] Window of standing; [rad/s], [m/s²] largest spreads in it; [s] shortest standing whose mean rate is the bias; [s]
time beside it; number of standings."""

TILTED_DEG = {"foot": 16.0, "ankle": 8.0, "shank": 8.0, "thigh": 7.0, **dict.fromkeys(TRUNK, 9.0)}
"""[deg] Tilt between standing and walking by the gyroscope against the accelerometer (foot 13.3, shank 5.8, thigh 4.3,
trunk 6.3)."""

# --- pace of walking ---

USUAL_PACE = {"foot": (4.8, 10.7), "ankle": (4.0, 7.8), "shank": (3.3, 6.8), "thigh": (1.95, 5.3)}
"""[rad], [m] Rms rate times the duration of a stride, and spread of the force times its square: means of all."""

STRIDE_S, UNLIKE, LEAST_AUTOCORRELATION, NEARLY = (0.3, 3.0), 0.3, 0.45, 0.8
"""[s] Duration of a stride; [1] autocorrelation below which the first one ends, least one of a stride, and share of the
largest from which on a shorter one is taken."""

SLOWEST_LEG, FEWEST_STRIDES, COUNTERPARTS, SAME_STRIDE, PIECE_S = (0.15, 0.3), 3.0, 0.5, 0.1, 10.0
"""[rad/s], [m/s²] Rms rate and spread of a leg that walks (0.6, 1.1); [1] strides of a piece; share of its samples with
a counterpart a stride later; difference of a sensor's stride from that of the others; [s] length of a piece."""

LARGE, SMALL, SMALLER = 1.55, 0.62, 0.7
"""[1] Angle, or shaking, over the usual that is too large, too small, and too small of slow walking (0.67 to 1.26)."""

SHAKEN_FAR, SPARED, SPARED_FAST, SHORT_STRIDE_S = 1.45, 0.58, 0.8, 0.65
"""[1] Shaking over angle of small angles (0.62 to 1.14); the last for strides shorter than [s] (0.72)."""

# --- order of samples ---

CHANGE_S, CALM_S, FARTHEST_S = 0.02, 0.12, 0.35
"""[s] Time over which the change of a signal is taken; of the moving mean that is taken off a force; largest delay."""

LEAST_ALIKE, WALKING = 0.3, 0.5  # [1] least correlation; share of the mean shaking in walking

CLEARER, CLEARER_FOOT = 0.05, 0.1
"""[1] Gain of the correlation by a delay in a foot, or between two sensors, and between shank and foot: a foot that
drags is shaken twice in a step; by any delay where a swing has few samples and is as sharp as an impact. Without it 6
of 96 simulated legs seem late, with it none; of 288 delays of 0.1 s 216 are found in place of 248."""

IN_SENSOR_S = {"foot": (-0.035, 0.032), "ankle": (-0.05, 0.027), "shank": (-0.05, 0.027), "thigh": (-0.06, 0.05)}
"""[s] Delay of the accelerometer behind the gyroscope (foot −0.025 to 0.02, shank −0.039 to 0.02, thigh −0.04 to
0.03)."""

BETWEEN_S = {("thigh", "shank"): 0.07, ("shank", "ankle"): 0.06, ("shank", "foot"): 0.13}
"""[s] Delay between two sensors of a leg (0.05)."""

DRIFTED_S = 12.0  # [s] shortest walk whose last third is compared alone: a clock that is fast is late there

SENSORS_OF_JUMP, SURE_JUMP, BESIDE_JUMP = 4, 0.8, 3
"""[1] Sensors that jump at one place; mean logarithm of their changes over others up to so many samples beside
(0.30, simulated 0.4)."""

STRAIGHT, FAST_HZ, LEAST_RATIO = {True: 0.8, False: 0.95}, {True: 80.0, False: 160.0}, {True: 0.45, False: 0.85}
"""[1], [Hz] With three sensors or more, and with fewer: cosine between a change and the expected one, and rate at which
neighbours tell it well; [1] double over longer steps at that rate or more, and below (0.38, 0.82)."""

TWO_STEPS, LONGER_STEP, SLOWEST_STEPS = np.log([1.6, 2.6]), np.log([1.2, 1.6]), 0.3
"""[1] Logarithm of a change over the expected one if a row is missing, and if it is only longer; share of steps, the
smallest ones, that do not count."""

EACH_SENSOR, LOST_SHARE, TWICE_SHARE, FEWEST_ROWS, ONE_STEP = 0.25, 0.02, 0.008, 10, 1.45
"""[1] Share of double steps of one sensor over that of another; shares of rows missing, and written twice (0.003);
their number; change after a repeated row over the expected one."""

RESOLVED, LEAST_CHANGE, COUNTED_S, UNBRIDGED, MOST_LOST = 10.0, 1e-3, 600.0, 3, 0.3
"""[steps] Least change that counts, [rad/s] and added to all; [s] part that is counted; [samples] gap around which
nothing counts; [1] largest share of lost samples."""

# --- sides and places ---

LIES = 0.05, 0.3  # [rad/s], [m/s²] spread over a window of a sensor that lies still

SIDES_APART, LEAST_MOVING, OUT_OF_STEP = 1.6, 0.2, 0.1
"""[1] Ratio of the rms rates of both legs (1.36), of which one has at least [rad/s]; [1] distance of one foot from half
a stride behind the other, which people who limp strongly reach."""

LEAST_TURN, TURN, TURN_FOOT, TURN_OF_TWO = 1.0, (0.7, 1.45), (0.45, 1.6), (0.33, 3.0)
"""[rad] Least turn of the person in a window; [1] a sensor's turn over it (0.82 to 1.33), a foot's, which turns in
steps (0.58 to 1.2), and one of two sensors over the other."""

RESTS_ALONE, CUT_OFF = 0.125, 2
"""[1] Difference from the others in the share of a window at rest; windows at an end in which a turn is not whole."""
