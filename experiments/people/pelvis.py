"""How the pelvis of the usual person moves: as lower backs do, at every harmonic of the stride.

`python -m experiments.people.pelvis` derives the means of the table of the pelvis from every second person of
`ipol_gait`, and writes the file; `shapes` runs it. What a sensor at the lower back of the usual simulated person, at
the strides of these people, lacks is added to the table as motion. The phase of a harmonic is that of the mean over
people, its size the median over people of that of single strides, which jitter does not blur. Run again, after
`movement`, it keeps the phases, and gives every harmonic its size.

The table has nothing of what differs between left and right steps. In forces its power counts at the harmonics beside
it, from `UNEVEN` on, where phases begin to differ from person to person.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.people import movement
from experiments.people.shapes import NUMBERS, PARTS_OF_STRIDE, lower_backs, moved, stride_lengths
from experiments.people.tables import tables, write
from jgait import simulate
from jgait.simulate import Person, shapes
from jgait.simulate.shapes import shape_of
from jgait.simulate.walker import moved as motion_of
from jgait.simulate.walker import planned, ticks
from jgait.simulate.worn import ideal_readings, sensors_at

ROUNDS, UNEVEN = 4, 4
"""[1] Rounds; first harmonic of the forces that has the power of those of unequal steps beside it."""
EVEN, ODD = (0, 2, 4), (1, 3, 5)
"""Motions forward, up and pitch, which have even harmonics alone, and those to the left, yaw and roll, which have odd
ones; forces and rates of both kinds stand at the same places."""


def known() -> list[str]:
    """People of `ipol_gait` from whom the table is derived."""
    return list(stride_lengths())[::2]


@jax.jit
def _stride(table: Any, who: Person) -> tuple[Any, Any, Any]:
    """Forces and rates (PARTS_OF_STRIDE, 3) at the lower back in a stride, and 1 where the left foot lands."""
    shape = shape_of(who)._replace(pelvis=table * shapes.sizes(who))
    laid, _ = planned(jax.random.key(0), who, simulate.straight(30.0), 8, shape)
    time = laid.contact[4] + who.gait.stride_time * jnp.arange(PARTS_OF_STRIDE) / PARTS_OF_STRIDE
    gyr, acc = ideal_readings(motion_of(who, laid, *ticks(laid, time)), sensors_at(who.body, ("lower_back",)))
    return acc[0], gyr[0], laid.side[4]


def made(table: np.ndarray, who: Person) -> np.ndarray:
    """(6, harmonics) of a simulated stride, as `shapes.harmonics`."""
    acc, gyr, side = map(np.asarray, _stride(table, who))
    waves = np.fft.rfft(np.concatenate([acc, gyr], axis=1).T)[:, NUMBERS] / PARTS_OF_STRIDE
    waves[ODD, :] *= side
    return waves


def rows_of(motion: np.ndarray) -> np.ndarray:
    """Rows of the table of the pelvis from motions (6, harmonics) as `shapes.moved` returns them."""
    forward, left, up, yaw, pitch, roll = motion
    waves = 2.0 * np.array([*(row[1::2] for row in (forward, up, pitch)), *(row[0::2] for row in (left, yaw, roll))])
    return np.concatenate([waves.real, -waves.imag], axis=1)


def derived(table: np.ndarray) -> np.ndarray:
    """The table of the usual person (6, 2 HARMONICS), from the present one."""
    lengths, backs = stride_lengths(), lower_backs()
    strides = [backs[name] for name in known()]
    times = [float(np.mean([time for _, time in one])) for one in strides]
    people = [movement.usual(movement.LEG, time, lengths[name]) for time, name in zip(times, known(), strict=True)]
    each = [np.array([waves for waves, _ in one]) for one in strides]
    mean = np.mean([one.mean(axis=0) for one in each], axis=0)
    size = np.median([np.sqrt(np.mean(np.abs(one) ** 2, axis=0)) for one in each], axis=0)
    has = np.isin(np.arange(6), EVEN)[:, None] == (NUMBERS % 2 == 0)
    beside = np.pad(np.where(has, 0.0, size**2), ((0, 0), (1, 1)))
    counts = (np.arange(6)[:, None] < 3) & (NUMBERS >= UNEVEN)
    size = np.sqrt(size**2 + np.where(counts, 0.5 * (beside[:, :-2] + beside[:, 2:]), 0.0))
    keeps = bool(table.any())
    for number in range(ROUNDS):
        own = np.array([made(table, who) for who in people])
        phase = own.mean(axis=0) / (np.abs(own.mean(axis=0)) + 1e-12)
        wanted = phase if keeps else mean / np.abs(mean)
        lacks = (size * wanted - np.median(np.abs(own), axis=0) * phase) * has
        force, rate = (np.sqrt(np.sum(np.abs(part) ** 2)) for part in np.split(lacks, 2))
        print(f"round {number + 1}: lacks {force:.3f} m/s² and {rate:.4f} rad/s", flush=True)
        table = table + rows_of(moved(lacks, float(np.mean(times))))
    return table


def main() -> None:
    """Derive the table and write the file."""
    known = tables()
    write(known | {"pelvis": derived(known["pelvis"])})


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
