"""A foot in plain NumPy: it stands, swings forward with its heel first up and then its toes, and stands again.

Positions are polynomials whose first three derivatives vanish at both ends of a swing, so that it starts and ends at
rest.
"""

import numpy as np
from made.track import FINE, Made, read, step, swung


def _rotation(yaw, pitch):
    """(T, 3, 3) axes of the sensor in the world, in columns: pitch about y (toes up positive), then yaw about z."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    zero = np.zeros_like(yaw)
    rows = [[cy * cp, -sy, -cy * sp], [sy * cp, cy, -sy * sp], [sp, zero, cp]]
    return np.moveaxis(np.array(rows), -1, 0)


def foot(
    strides=5, length=1.2, swing=0.5, stance=0.6, hz=100.0, turns=0.0, rises=0.0, rest=1.5, mount=None,
    bias=(0, 0, 0), side="right", roll=0.0, held=0.0, seed=None,
):  # fmt: skip
    """A walk of one foot.

    Args:
        strides: how many.
        length: of each [m], or a list; so are `turns`, changes of heading [rad], and `rises` [m].
        swing: duration of a swing [s].
        stance: between swings [s].
        hz: sampling rate [Hz].
        rest: standing before and after [s].
        side: of the placement.
        roll: from toes up to toes down by twice this the foot turns about the ground below it between swings [rad].
        held: share of its rate that the foot loses in the middle of each swing: with 1 it does not turn there.
        mount, bias, seed: as of `read`.
    """
    lengths, turns, rises = (np.broadcast_to(np.asarray(v, float), strides) for v in (length, turns, rises))
    begin = rest + (swing + stance) * np.arange(strides)
    n = round((begin[-1] + swing + rest) * hz)
    t = np.arange(n * FINE) / (hz * FINE)
    place, yaw = swung(t, begin, swing, lengths, turns, rises, 0.12)
    pitch = np.zeros(t.size)
    for start in begin:
        s = np.clip((t - start) / swing, 0.0, 1.0)
        s += held / (2.0 * np.pi) * np.sin(2.0 * np.pi * s)
        # heel up first, then toes up; both gone at the end
        pitch += 900.0 * (s * (1.0 - s)) ** 4 * (s - 0.55)
    # between two swings the foot rolls from toes up to toes down, and back within the swing
    for k in range(strides - 1):
        pitch -= 2.0 * roll * step((t - begin[k] - swing) / stance)
        pitch += 2.0 * roll * step((t - begin[k + 1]) / swing)
    pitch += roll * step((t - begin[0]) / swing)
    recording = read(t, place, _rotation(yaw, pitch), f"foot_{side}", hz, mount, bias, seed)
    return Made(recording, lengths, rises, turns, begin, begin + swing)
