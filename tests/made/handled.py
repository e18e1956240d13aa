"""Sensors that are put on or taken off while they record: turned about by hands beside what they record when worn."""

import numpy as np

from jgait.types import Imu

HELD_S, STANDS_S, HAND_HZ = 6.0, 2.0, 1.0
"""[s] In a hand, and in standing between that and the recording. [Hz] About the fastest turns of a hand."""


def put_on(
    imu: Imu, rate_hz: float, *, turns: float = 1.0, shakes: float = 1.0, lies_s: float = 0.0, seed: int = 0
) -> Imu:
    """A sensor that lies on a table [s], is held in a hand that turns [rad/s] and shakes it [m/s²], and is then worn;
    its first half second is of standing. Time goes on over all parts.
    """
    gyr, acc = (np.asarray(part, float) for part in (imu.gyr, imu.acc))
    up = acc[: int(0.5 * rate_hz)].mean(axis=0)
    held, stands, lies = (int(seconds * rate_hz) for seconds in (HELD_S, STANDS_S, lies_s))
    turned, shaken = (_smooth(held, rate_hz, size, seed + k) for k, size in enumerate((turns, shakes)))
    force, forces = up, []
    for rate in turned[::-1]:  # back in time; gravity turns against the sensor
        force = force + np.cross(rate, force) / rate_hz
        force = force * np.linalg.norm(up) / np.linalg.norm(force)
        forces.append(force)
    still = [np.tile(one[: int(0.5 * rate_hz)], (stands, 1))[:stands] for one in (gyr, acc)]
    table = np.zeros((lies, 3)), np.tile(forces[-1], (lies, 1))
    gyr = np.concatenate([table[0], turned, still[0], gyr])
    acc = np.concatenate([table[1], np.array(forces[::-1]) + shaken, still[1], acc])
    mask = np.concatenate([np.ones(len(gyr) - len(imu.mask), bool), imu.mask])
    return imu._replace(time=np.arange(len(gyr)) / rate_hz, gyr=gyr, acc=acc, mask=mask)


def taken_off(imu: Imu, rate_hz: float, **hand) -> Imu:
    """The same behind the recording, whose last half second is of standing."""
    back = put_on(_reversed(imu), rate_hz, **hand)
    return _reversed(back)._replace(time=back.time)


def _reversed(imu: Imu) -> Imu:
    """Backwards in time."""
    gyr, acc = (np.asarray(part, float)[::-1] for part in (imu.gyr, imu.acc))
    return imu._replace(gyr=-gyr, acc=acc, mask=np.asarray(imu.mask)[::-1])


def _smooth(samples: int, rate_hz: float, size: float, seed: int) -> np.ndarray:
    """(samples, 3) noise below about `HAND_HZ`, of a root mean square, that begins and ends at 0."""
    noise = np.random.default_rng(seed).normal(size=(samples, 3))
    width = np.hanning(int(rate_hz / HAND_HZ) + 2)
    smooth = np.stack([np.convolve(one, width, mode="same") for one in noise.T], axis=1)
    return size * smooth / smooth.std() * np.minimum(1.0, np.linspace(0.0, samples / rate_hz, samples))[::-1, None]
