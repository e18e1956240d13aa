r"""Orientation of a sensor on the shank or at the ankle, computed from walking; on the host, not under jit.

A shank in walking turns about one axis, and turns fastest in the forward swing; gravity gives the vertical. So the
wearer need not report a sensor that is upside down, on the other leg or turned about the leg. The axes are forward,
left and up, as of a standing segment; the forward swing is a *negative* rate about the axis to the left.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jgait.events.rest import LEGS_SHORTEST_S, longest_still
from jgait.mounting.places import places_in
from jgait.notes import Note
from jgait.signal.windows import over_losses
from jgait.types import SIDES, AnyArray, Imu, Recording, RecordingError, as_float

RESTING = 0.1
"""[rad/s] Largest root mean square rate of a leg at rest, gyroscope bias included. Chosen by hand."""

LEAST_ASYMMETRY = 0.3
"""[1] Skewness of the sagittal rate below which its sign is uncertain; public walks have 1.0 to 2.6."""


class Axes(NamedTuple):
    """Orientation of a sensor on its segment."""

    rows: np.ndarray  #: (3, 3) forward, left and up in the sensor's axes [1]; `gyr @ rows.T` is in the segment's axes.
    asymmetry: float  #: skewness of the sagittal rate [1], negative: the forward swing is faster than backward rotation


def functional_axes(imu: Imu) -> Axes | None:
    """Forward, left and up in a sensor's axes, from angular rate and specific force in walking; None if the leg does
    not walk.

    Left is the axis perpendicular to the median specific force about which the moving sensor turned most; with its
    sign, the rate of the forward swing, the faster rotation, is negative.

    Raises:
        RecordingError: if there is no accelerometer.
    """
    if imu.acc is None:
        raise RecordingError("the axes of a shank need an accelerometer; the sensor has a gyroscope only")
    kept = np.asarray(imu.mask, bool)
    gyr, acc = as_float(imu.gyr)[kept], as_float(imu.acc)[kept]
    speed = np.linalg.norm(gyr, axis=1)
    moving = speed > 1.0  # [rad/s] in swing
    if len(gyr) == 0 or np.percentile(speed, 99.0) < 0.5:  # [rad/s] in standing, noise decides which turns faster
        return None
    up = np.median(acc, axis=0)
    up = up / np.linalg.norm(up)
    level = gyr[moving] - np.outer(gyr[moving] @ up, up)
    left = np.linalg.eigh(level.T @ level)[1][:, -1]
    left = left - (left @ up) * up
    left = left / np.linalg.norm(left)
    rate = gyr @ left
    power = float(np.mean(rate**2)) if rate.size else 0.0
    skew = float(np.mean(rate**3)) / power**1.5 if power > 0.0 else 0.0
    left = -np.sign(skew) * left if skew != 0.0 else left
    return Axes(np.stack([np.cross(left, up), left, up]), -abs(skew))


def rest_bias(imu: Imu, sampling_rate_hz: float) -> np.ndarray | None:
    """The gyroscope bias while the leg stands, calibrated as in the paper: (3,) [rad/s], the median over the longest
    rest of at least half a second; None without. A bias of 0.02 rad/s changes the stride length by 2 %.
    """
    run = longest_still(imu.gyr, sampling_rate_hz, mask=imu.mask, threshold=RESTING, at_least_s=LEGS_SHORTEST_S)
    if run is None:
        return None
    kept = np.asarray(imu.mask, bool)[run[0] : run[1]]
    return np.asarray(np.median(as_float(imu.gyr)[run[0] : run[1]][kept], axis=0))


def filled(imu: Imu) -> Imu:
    """The sensor with lost samples interpolated between their neighbours; the mask stays as it is. Raises
    RecordingError if every sample was lost.
    """
    kept = np.asarray(imu.mask, bool)
    if not kept.any():
        raise RecordingError("every sample of the sensor was lost")
    if kept.all():
        return imu
    time = as_float(imu.time)
    acc = None if imu.acc is None else over_losses(time, imu.acc, kept)
    return imu._replace(gyr=over_losses(time, imu.gyr, kept), acc=acc)


def stance_up(axes: Axes, acc: Float[AnyArray, "time 3"], instants: Int[AnyArray, "instant"]) -> Axes:
    """The axes with up along the mean specific force [m/s²] at given samples (n,), as the stance valleys, in which the
    ankle hardly accelerates and the shank leans by a constant few degrees at most; unchanged with n = 0.
    """
    if len(instants) == 0:
        return axes
    up = as_float(acc)[np.asarray(instants)].mean(axis=0)
    up = up - (up @ axes.rows[1]) * axes.rows[1]
    up = up / np.linalg.norm(up)
    return axes._replace(rows=np.stack([np.cross(axes.rows[1], up), axes.rows[1], up]))


def worn_on_shank(recording: Recording, side: str) -> tuple[str, Note | None]:
    """The placement that is stated for the sensor on a shank, and a note if this is not `shank_<side>`: how sensors on
    thighs, shanks and feet move together shows it. Raises RecordingError if there is no sensor on that shank.
    """
    if side not in SIDES:
        raise ValueError(f"side must be 'right' or 'left'; got {side!r}")
    shank = f"shank_{side}"
    if shank not in recording.sensors:
        raise RecordingError(f"a sensor on {shank} is needed; the recording has {', '.join(recording.sensors)}")
    places = places_in(recording.sensors)
    if places is None or shank not in places.moved:
        return shank, None
    return places.worn.get(shank, shank), places.notes()[0]
