"""Mean strides of recorded and of simulated legs, in harmonics of what the sensors on thigh, shank and foot read.

Sensors are turned alike: their axis to the left is that about which they turn most, their upward axis that of the mean
specific force.
"""

from typing import Any, NamedTuple

import numpy as np

from experiments.people.legs import Leg
from experiments.simulator.gait import find_strides, sagittal_rates
from jgait.simulate import shapes
from jgait.simulate.shapes import OUTWARDS, WORN

SEGMENTS, POINTS = ("thigh", "shank", "foot"), 100
HARMONICS = np.arange(1, 2 * shapes.HARMONICS + 1)


class Waves(NamedTuple):
    """Mean and size of the strides of a leg, in harmonics: (segments, signals, harmonics); its stride time [s]."""

    mean: np.ndarray
    size: np.ndarray
    stride_time: float


def axes(gyr: np.ndarray, acc: np.ndarray, rate: np.ndarray, windows: Any) -> np.ndarray:
    """(3, 3) forward, left and up axis of a sensor as columns, from its rate in swing (T,), forward positive."""
    even = np.concatenate([np.arange(*one) for one in windows])
    left = -gyr[even].T @ rate[even]
    left = left / np.linalg.norm(left)
    up = acc[even].mean(axis=0)
    up = up - left * (up @ left)
    up = up / np.linalg.norm(up)
    return np.stack([np.cross(left, up), left, up], axis=1)


def mean_stride(leg: Leg, rate_hz: float) -> Waves | None:
    """Of a recorded leg, in strides from one swing to the next; None without strides or a sensor."""
    if not set(SEGMENTS) <= set(leg.sensors):
        return None
    leader, rates = sagittal_rates(leg.sensors, rate_hz, leg.windows)
    strides = find_strides(rates[leader], rate_hz, leg.windows, leg.trim, leg.good)
    if not len(strides.start):
        return None
    of = ((*map(np.asarray, leg.sensors[segment]), rates[segment]) for segment in SEGMENTS)
    series = np.concatenate([signals(*each, leg.windows, leg.side) for each in of])
    index = np.arange(series.shape[1])
    cut = np.array([
        [np.interp(np.linspace(a, b, POINTS, endpoint=False), index, row) for row in series]
        for a, b in zip(strides.start, strides.end, strict=True)
    ])  # fmt: skip
    waves = harmonics(cut).reshape(len(cut), len(SEGMENTS), len(WORN), -1)
    time = float(np.mean(strides.end - strides.start)) / rate_hz
    return Waves(waves.mean(axis=0), np.sqrt(np.mean(np.abs(waves) ** 2, axis=0)), time)


def signals(gyr: np.ndarray, acc: np.ndarray, rate: np.ndarray, windows: Any, side: str) -> np.ndarray:
    """(6, T) rates [rad/s] and specific forces [m/s²] in the directions of `WORN`."""
    turned = axes(gyr, acc, rate, windows)
    (rolls, pitches, yaws), (ahead, left, up) = (gyr @ turned).T, (acc @ turned).T
    return np.stack([pitches, ahead, up, rolls, yaws, left]) * OUTWARDS[side][:, None]


def harmonics(series: np.ndarray) -> np.ndarray:
    """Half of each harmonic of a stride, complex."""
    return np.fft.rfft(series, axis=-1)[..., HARMONICS] / POINTS


def late(recorded: np.ndarray, simulated: np.ndarray) -> float:
    """By how much later a recorded stride begins [rad]: where the harmonics of a signal are most alike."""
    grid = np.linspace(-np.pi, np.pi, 400)
    alike = np.exp(1j * grid[:, None] * HARMONICS) @ (simulated * np.conj(recorded))
    return float(grid[np.argmax(alike.real)])
