r"""How far apart the feet of usual people pass each other: what takes the place of a range that nobody measured.

In mid-swing a foot passes the other one, which stands: it has then made half of its stride, since the steps of most
people are alike, and the feet are nearly as far apart at each passing of a walk (within 0.5 to 2 cm). This distance
differs from the width w between footholds by δ, how far the swinging foot keeps outside of the line between its own two
footholds. Each foot's trajectory shows its δ. Between people, both distances vary alike; with the mean of δ over a walk

    z₁ = μ + δ̄ / 2,

at each passing, which is half of what usual distances at passings say of the width, and half of what usual widths say.
So changes of the width from stride to stride are measured, and so are those of the headings; the mean width has the
spread of people (`WidthParams.people_noise`), and that of a person with a wide or a narrow base is wrong by more.

Source: this library. μ from the markers on 8 healthy people: 4 of `nikonpic`, 3 of `gaitspeed`, 1 of `gaitmap_example`,
with widths of 7 to 15 cm, distances at passings of 9 to 17 cm, and δ from −3 to 5 cm (middle of heel and toe).
"""

import itertools

import numpy as np

from jgait.estimators.stride_width_ekf.trajectories import Pair

SHORTEST_M = 0.5
"""[m] Shortest stride of a passing; feet that shuffle or turn on the spot do not pass as in walking."""


def passings(pair: Pair) -> tuple[np.ndarray, np.ndarray]:
    """Times at which a foot has made half of its stride (n,) [s], and the mean of δ (n,) [m]."""
    times, outside = [], []
    for side, foot in enumerate(pair):
        for first, last in itertools.pairwise(np.searchsorted(foot.time, foot.mids)):
            way = foot.position[first : last + 1, :2] - foot.position[first, :2]
            length = float(np.hypot(*way[-1]))
            if length < SHORTEST_M:
                continue
            along, left = way @ way[-1] / length, (way[:, 1] * way[-1, 0] - way[:, 0] * way[-1, 1]) / length
            half = int(np.argmax(along >= 0.5 * length))
            times.append(foot.time[first + half])
            outside.append(left[half] if side else -left[half])
    return np.array(times), np.full(len(times), np.mean(outside) if outside else 0.0)
