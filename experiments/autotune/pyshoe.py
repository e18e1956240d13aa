r"""PyShoe's filter beside: nine states, zero velocity from SHOE with the threshold best for each trial, and with one.

State p, v, and attitude error δ with R' = exp(δ×) R; strapdown steps, R and Q as published: force .5 m/s², rate .5°/s,
zero velocity .01 m/s. SHOE is (1/n) Σ |f − g f̄/|f̄||²/σ_a² + |ω|²/σ_ω² over five samples.

Source: B. Wagstaff, V. Peretroukhin and J. Kelly, "Improving foot-mounted inertial navigation through real-time motion
classification", 2017; I. Skog et al., "Zero-velocity detection: an algorithm evaluation", 2010.
"""

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from experiments.autotune.walks import KINDS, kind
from experiments.common.recordings import available, names, walks
from experiments.common.row import Row, show
from jgait.evaluate import yaw_aligned
from jgait.geometry.vectors import GRAVITY
from jgait.types import Walk

FORCE, RATE, STILL = 0.5, np.radians(0.5), 0.01
"""[m/s²], [rad/s], [m/s] Standard deviations."""

WINDOW, SIGMA_ACC, SIGMA_GYR, THRESHOLD = 5, 0.00098, 8.7e-5, 2.9e7
"""SHOE's window [samples], scales and the one threshold: the median of those that are best for a trial."""


def shoe(gyr: np.ndarray, acc: np.ndarray) -> np.ndarray:
    """SHOE (T,) [1]; the ends are repeated."""

    def mean(values: np.ndarray) -> np.ndarray:
        return np.asarray(ndimage.uniform_filter1d(values, WINDOW, axis=0, mode="nearest"))

    middle = mean(acc)
    length = np.linalg.norm(middle, axis=1)
    # ⟨|f − g u|²⟩ = ⟨|f|²⟩ − 2 g |f̄| + g²
    off = mean((acc**2).sum(axis=1)) - 2.0 * GRAVITY * length + GRAVITY**2
    return off / SIGMA_ACC**2 + mean((gyr**2).sum(axis=1)) / SIGMA_GYR**2


def upright(acc: np.ndarray) -> np.ndarray:
    """The smallest rotation (3, 3) that turns a specific force (3,) at rest to z."""
    axis = np.array([acc[1], -acc[0], 0.0])
    sine = np.linalg.norm(axis)
    return Rotation.from_rotvec(axis / max(sine, 1e-12) * np.arctan2(sine, acc[2])).as_matrix()


def path(gyr: np.ndarray, acc: np.ndarray, stands: np.ndarray, dt: float) -> np.ndarray:
    """(T, 3) positions [m] of the filter, without smoothing."""
    p, v = np.zeros(3), np.zeros(3)
    turn = upright(acc[:20].mean(axis=0))
    steps = Rotation.from_rotvec(gyr * dt).as_matrix()
    cov = np.diag([1e-10] * 6 + [np.radians(0.1) ** 2] * 3)
    noise = np.diag([0.0] * 3 + [(FORCE * dt) ** 2] * 3 + [(RATE * dt) ** 2] * 3)
    move, still = np.eye(9), STILL**2 * np.eye(3)
    move[:3, 3:6] = dt * np.eye(3)
    found = np.zeros((len(gyr), 3))
    for k in range(1, len(gyr)):
        turn = turn @ steps[k]
        x, y, z = force = turn @ acc[k]
        v = v + dt * (force - np.array([0.0, 0.0, GRAVITY]))
        p = p + dt * v
        move[3:6, 6:] = -dt * np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        cov = move @ cov @ move.T + noise
        if stands[k]:
            gain = cov[:, 3:6] @ np.linalg.inv(cov[3:6, 3:6] + still)
            change = -gain @ v
            p, v = p + change[:3], v + change[3:6]
            turn = Rotation.from_rotvec(change[6:]).as_matrix() @ turn
            cov = cov - gain @ cov[3:6]
            cov = 0.5 * (cov + cov.T)
        found[k] = p
    return found


def error(walk: Walk, stands: np.ndarray) -> float:
    """3-D error of a trial after yaw and shift [m]."""
    assert walk.reference is not None
    assert walk.reference.feet is not None
    assert walk.reference.feet.right is not None
    imu, good = walk.recording.sensors["foot_right"], np.asarray(walk.reference.valid, bool)
    ours = path(imu.gyr, imu.acc, stands, 1.0 / walk.recording.sampling_rate_hz)[good]
    theirs = np.asarray(walk.reference.feet.right.position)[good]
    return float(np.sqrt(np.mean(np.sum((yaw_aligned(ours, theirs) - theirs) ** 2, axis=1))))


def rows(quick: bool) -> list[Row]:
    """Medians of each kind of gait, with both detectors."""
    if not available("pyshoe_vicon"):
        return []
    found: dict[tuple[str, str], list[float]] = {}
    for walk in walks("pyshoe_vicon", names("pyshoe_vicon")[::9] if quick else None):
        imu = walk.recording.sensors["foot_right"]
        detectors = {"best": walk.info["zero_velocity"]["shoe"], "one": shoe(imu.gyr, imu.acc) < THRESHOLD}
        for name, stands in detectors.items():
            found.setdefault((kind(walk.info["speed"]), name), []).append(error(walk, stands))
    words = {"best": "threshold best for each trial by hindsight", "one": "one threshold"}
    lines = [[of, *(float(np.median(found[of, name])) for name in words)] for of in KINDS if (of, "one") in found]
    show("PyShoe's filter: 3-D error of positions [m], median", ["", *words.values()], lines)
    return [
        Row(f"pyshoe_{name}_position_m_{of}", float(np.median(errors)), "m", n=len(errors), split=words[name])
        for (of, name), errors in found.items()
    ]
