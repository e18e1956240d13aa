"""How sensors on thighs, shanks and feet of recorded people move over the bone: out of the sagittal plane, and in it.

`python -m experiments.people.out_of_plane` derives rows of the table of the skin from the people to whom `shapes` fits
the rest, and writes the file; `shapes` runs it last. In harmonics of the stride (`waves`), what the usual person lacks
is added: rates as turns, specific forces as motion. Phases are those of the mean over legs. The size of a harmonic is
the median over legs of that of single strides, which jitter does not blur, less what the styles add. The styles are the
directions in which legs differ most out of the plane, in order of size.

In the plane only the mean changes, from the harmonics of `FIRST` on: at thighs all that the bones, whose motion feet
and pelvis fix, leave open.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.sets import datasets
from experiments.people import movement
from experiments.people.legs import legs_of
from experiments.people.tables import tables, write
from experiments.people.waves import HARMONICS, POINTS, SEGMENTS, Waves, harmonics, late, mean_stride, signals
from jgait.simulate import Person, shapes
from jgait.simulate.shapes import WORN, shape_of

LARGEST = 3.0
"""[1] Largest size of a harmonic over that of the mean of all legs."""
TURNING = np.array([name in ("pitch", "roll", "yaw") for name in WORN])[:, None]
"""(6, 1) bool, of `WORN`: whether it is a turn."""
FREE = np.array([
    [name in (("roll", "yaw") if segment == "foot" else ("roll", "yaw", "aside")) for name in WORN]
    for segment in SEGMENTS
])[..., None]  # fmt: skip
"""(segments, 6, 1) bool: what is derived here; a sensor on a foot only turns."""
FIRST = {("thigh", "pitch"): 1, ("thigh", "ahead"): 2, ("thigh", "along"): 2}
"""First harmonic that is derived here of the mean in the plane of the leg."""
MEAN = FREE | np.array([
    [FIRST.get((segment, name), np.inf) <= HARMONICS for name in WORN] for segment in SEGMENTS
])  # fmt: skip
"""(segments, 6, harmonics) bool: what of the mean is derived here."""
SHANK = SEGMENTS.index("shank"), WORN.index("pitch")
ROUNDS, DRAWS = 5, 48
FORCE = 5.0
"""[m/s²] A specific force that counts as much as a rate of 1 rad/s when styles are ordered."""


@jax.jit
def _stride(table: Any, who: Person) -> tuple[Any, Any]:
    """(segments, POINTS, 3) rates and specific forces of a simulated stride."""
    shape = shape_of(who)._replace(skin=jnp.tensordot(shapes.weights(who), table, 1))
    return movement.walked_stride(who, shape)[0]


def made(table: np.ndarray, who: Person) -> np.ndarray:
    """(segments, 6, harmonics) of a simulated stride."""
    both = zip(*map(np.asarray, _stride(table, who)), strict=True)
    return np.stack([harmonics(signals(g, a, -g[:, 1], [(0, POINTS)], "right")) for g, a in both])


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
    turns = [np.exp(-1j * late(one.mean[SHANK], own[SHANK]) * HARMONICS) for one, own in zip(legs, usual, strict=True)]
    means = np.array([one.mean * turn for one, turn in zip(legs, turns, strict=True)])
    mean, power = means.mean(axis=0), np.median([one.size for one in legs], axis=0) ** 2
    rate = 2.0 * np.pi * HARMONICS / np.mean([one.stride_time for one in legs])
    gain = np.where(TURNING, 1j * rate, -(rate**2))
    table = table.copy()
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
    return table


def main() -> None:
    """Derive the table and write the file."""
    known = tables()
    write(known | {"skin": derived(known["skin"])})


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
