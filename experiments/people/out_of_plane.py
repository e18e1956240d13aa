"""How sensors on thighs, shanks and feet of recorded people move over the bone: out of the sagittal plane, and in it.

`python -m experiments.people.out_of_plane` derives rows of the table of the skin from the people to whom `shapes` fits
the rest, and writes the file; run it after `pelvis`. Sensors of a recorded and of a simulated leg are turned alike:
their axis to the left is that about which they turn most, their upward axis that of the mean specific force. In
harmonics of the stride, what the simulated person lacks is added: rates as turns, specific forces as motion. Phases are
those of the mean over legs. The size of a harmonic is the median over legs of that of single strides, which jitter does
not blur, less what the styles add. The styles are the directions in which legs differ most out of the plane, in order
of size.

In the plane only the mean changes, from the harmonics of `FIRST` on: at thighs all that the bones, whose motion feet
and pelvis fix, leave open; at shanks half of what impacts lack. All of it, or lower harmonics, would make strides by
shanks twice as wrong as recorded ones, and give all simulated shanks impacts of one shape.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.people import movement
from experiments.people.legs import Leg, legs_of
from experiments.people.shapes import FILE, written
from experiments.simulator.gait import find_strides, sagittal_rates
from jgait import datasets
from jgait.simulate import Person, shapes
from jgait.simulate.shapes import OUTWARDS, WORN, shape_of

SEGMENTS, POINTS = ("thigh", "shank", "foot"), movement.POINTS
HARMONICS = np.arange(1, 2 * shapes.HARMONICS + 1)
LARGEST = 3.0
"""[1] Largest size of a harmonic over that of the mean of all legs."""
TURNING = np.array([name in ("pitch", "roll", "yaw") for name in WORN])[:, None]
"""(6, 1) bool, of `WORN`: whether it is a turn."""
FREE = np.array([
    [name in (("roll", "yaw") if segment == "foot" else ("roll", "yaw", "aside")) for name in WORN]
    for segment in SEGMENTS
])[..., None]  # fmt: skip
"""(segments, 6, 1) bool: what is derived here; a sensor on a foot only turns."""
FIRST = {
    **{("thigh", name): first for name, first in (("pitch", 1), ("ahead", 2), ("along", 2))},
    **{("shank", name): 7 for name in ("pitch", "ahead", "along")},
}
"""First harmonic that is derived here of the mean in the plane of the leg."""
MEAN = FREE | np.array([
    [FIRST.get((segment, name), np.inf) <= HARMONICS for name in WORN] for segment in SEGMENTS
])  # fmt: skip
"""(segments, 6, harmonics) bool: what of the mean is derived here."""
IMPACTS = slice(len(WORN), len(WORN) + 3)
"""Rows of the table that are derived by half: those of the shank in the plane."""
ROUNDS, DRAWS = 5, 48
FORCE = 5.0
"""[m/s²] A specific force that counts as much as a rate of 1 rad/s when styles are ordered."""


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
    """Of a recorded leg, in strides from one swing to the next; None without strides."""
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


@jax.jit
def _stride(table: Any, who: Person) -> tuple[Any, Any]:
    """(segments, POINTS, 3) rates and specific forces of a simulated stride."""
    shape = shape_of(who)._replace(skin=jnp.tensordot(shapes.weights(who), table, 1))
    (gyr, acc), _ = movement.walked_stride(who, shape)
    order = np.array([1, 0, 2])  # from shank, thigh, foot
    return gyr[order], acc[order]


def made(table: np.ndarray, who: Person) -> np.ndarray:
    """(segments, 6, harmonics) of a simulated stride."""
    both = zip(*map(np.asarray, _stride(table, who)), strict=True)
    return np.stack([harmonics(signals(g, a, -g[:, 1], [(0, POINTS)], "right")) for g, a in both])


def late(recorded: np.ndarray, simulated: np.ndarray) -> float:
    """By how much later a recorded stride begins [rad]: where the rates of the shanks are most alike."""
    grid, shank = np.linspace(-np.pi, np.pi, 400), (SEGMENTS.index("shank"), WORN.index("pitch"))
    alike = np.exp(1j * grid[:, None] * HARMONICS) @ (simulated[shank] * np.conj(recorded[shank]))
    return float(grid[np.argmax(alike.real)])


def recorded() -> tuple[list[Waves], list[Person]]:
    """Every leg, and the usual person at its stride, of every second person of `walking5m`."""
    legs, people, known = [], [], movement.known()
    for walk in datasets.load("walking5m", list(known)):
        target, given = known[walk.recording.name]
        at = (target.medians[name] for name in ("stride_time", "stride_length"))
        who = jax.tree.map(float, movement.usual(target.leg, *at))
        found = [one for part in legs_of(walk, given) if (one := mean_stride(part, given.rate_hz)) is not None]
        legs += found
        people += [who] * len(found)
    return legs, people


def amounts(waves: np.ndarray) -> np.ndarray:
    """Rows of the table, cosines, then sines (…, segments × 6, 4 HARMONICS), from `harmonics`."""
    flat = waves.reshape(*waves.shape[:-3], len(SEGMENTS) * len(WORN), len(HARMONICS))
    return 2.0 * np.concatenate([flat.real, -flat.imag], axis=-1)


def styles(apart: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """(styles, segments, 6, harmonics) motions in whose directions legs differ most, from their differences (legs, …)
    from the mean; one standard deviation long."""
    weight = np.where(TURNING, 1.0, 1.0 / FORCE)
    flat = (apart * weight * FREE).reshape(len(apart), -1)
    _, size, directions = np.linalg.svd(np.concatenate([flat.real, flat.imag], axis=1), full_matrices=False)
    count = len(shapes.STYLES)
    print("share of the differences:", (size**2 / np.sum(size**2))[: count + 2].round(2))
    real, imaginary = np.split(size[:count, None] * directions[:count] / np.sqrt(len(apart) - 1.0), 2, axis=1)
    return (real + 1j * imaginary).reshape(count, *apart.shape[1:]) / weight / gain


def derived(table: np.ndarray) -> np.ndarray:
    """The table (1 + 2 + styles, rows, columns), from the present one."""
    legs, people = recorded()
    usual = [made(table, who) for who in people]
    turns = [np.exp(-1j * late(one.mean, own) * HARMONICS) for one, own in zip(legs, usual, strict=True)]
    means = np.array([one.mean * turn for one, turn in zip(legs, turns, strict=True)])
    mean, power = means.mean(axis=0), np.median([one.size for one in legs], axis=0) ** 2
    rate = 2.0 * np.pi * HARMONICS / np.mean([one.stride_time for one in legs])
    gain = np.where(TURNING, 1j * rate, -(rate**2))
    table, before = table.copy(), table[0]
    table[:, FREE.ravel()] = 0.0
    table[3:] += amounts(styles(means - mean, gain))
    rng = np.random.default_rng(0)
    for number in range(ROUNDS):
        usual = np.array([made(table, who) for who in people])
        differs = np.zeros(mean.shape)
        for i in rng.integers(len(people), size=DRAWS):
            own = dict(zip(shapes.STYLES, rng.standard_normal(len(shapes.STYLES)), strict=True))
            who = Person(people[i].body, people[i].gait._replace(**own))
            differs += np.abs(made(table, who) - usual[i]) ** 2 / DRAWS
        size = np.minimum(np.sqrt(np.maximum(power - differs, 0.0)), LARGEST * np.abs(mean))
        lacks = (size * mean / np.abs(mean) - usual.mean(axis=0)) * MEAN
        of_turns, of_forces = (np.sqrt(np.sum(np.abs(lacks * one) ** 2)) for one in (TURNING, ~TURNING))
        print(f"round {number + 1}: lacks {of_turns:.3f} rad/s and {of_forces:.3f} m/s²", flush=True)
        table[0] += amounts(lacks / gain)
    table[0, IMPACTS] = 0.5 * (before[IMPACTS] + table[0, IMPACTS])
    return table


def main() -> None:
    """Derive the table and write the file."""
    tables = {name: np.asarray(shapes.TABLES[name]) for name in ("pelvis", "feet")}
    FILE.write_text(written(shapes.TABLES["source"], {**tables, "skin": derived(shapes.SKIN)}), encoding="utf-8")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
