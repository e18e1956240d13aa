"""The harmonics of the simulated pelvis: `python -m experiments.people.pelvis` derives them and writes their file.

They are those of the lower back of the 12 people of `ipol_gait` and of one of `mobgap_lab`, over strides from a contact
to the next but one, on straight parts. The angular rates give the angles; the specific force, less gravity that the
tilt turns into it, the displacements. A phase is that of the mean over people, an amplitude the median over people,
between that of the mean stride (which jitter blurs) and that of single strides (which includes noise). The first wave
of each motion, and the first two of the height, are parameters of the gait and left out. No set with which the
simulator is compared takes part.
"""

import textwrap
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from jgait import datasets
from jgait.geometry.vectors import GRAVITY
from jgait.simulate import Body, pelvis, recorded_pelvis
from jgait.types import Walk

SETS = {"ipol_gait": (0.0, 0.0, -1.0), "mobgap_lab": (0.0, 0.0, 1.0)}
"""Sets → the axis of the sensor on the lower back that points forward."""
POINTS, ENDS = 96, 2
"""[1] Points of a stride at which signals are read; contacts left out at both ends of a straight part."""
STEP_TIME = (0.35, 0.9)
"""[s] Limits of the step times of strides that count."""
NUMBERS = np.arange(1, 2 * pelvis.COUNT + 1)
OWN = (1, 2, 1, 1, 1, 1)
"""[1] Number of waves of each row that are parameters of the gait."""


def strides(walk: Walk, forward: tuple[float, float, float]) -> Iterator[np.ndarray]:
    """Of each stride: forward, left, up [m], yaw, pitch, roll [rad] of the pelvis (6, harmonics), complex.

    Motions to a side are counted towards the foot that lands at the start.
    """
    imu = walk.recording.sensors["lower_back"]
    time, mask = np.asarray(imu.time), np.asarray(imu.mask)
    contacts, sides = walk.info["initial_contacts"], walk.info["initial_contact_sides"]
    for first, last in walk.info["straight_parts"]:
        inside = np.flatnonzero((contacts >= first - 1e-6) & (contacts <= last + 1e-6))[ENDS:-ENDS]
        if len(inside) < 5:
            continue
        a, b = np.searchsorted(time, contacts[inside[[0, -1]]])
        up = np.asarray(imu.acc)[a:b].mean(axis=0)
        gravity = np.linalg.norm(up)
        up = up / gravity
        ahead = np.asarray(forward) - up * (up @ np.asarray(forward))
        ahead = ahead / np.linalg.norm(ahead)
        level = np.stack([ahead, np.cross(up, ahead), up], axis=1)
        acc = np.asarray(imu.acc)[a:b] @ level * GRAVITY / gravity
        signals = np.concatenate([acc, np.asarray(imu.gyr)[a:b] @ level], axis=1).T
        for i in inside[:-2]:
            begin, middle, end = contacts[i : i + 3]
            even = sides[i] == sides[i + 2] != sides[i + 1]
            good = mask[slice(*np.searchsorted(time, [begin, end]))].all()
            if even and good and all(STEP_TIME[0] < step < STEP_TIME[1] for step in (middle - begin, end - middle)):
                steps = [np.linspace(*ends, POINTS // 2, endpoint=False) for ends in ((begin, middle), (middle, end))]
                read = np.stack([np.interp(np.concatenate(steps), time[a:b], row) for row in signals])
                waves = np.fft.rfft(read)[:, NUMBERS] / POINTS
                side = 1.0 if sides[i] == 1 else -1.0
                yield moved(waves, end - begin) * np.array([1.0, side, 1.0, side, 1.0, side])[:, None]


def moved(waves: np.ndarray, stride_time: float) -> np.ndarray:
    """Motion of the middle of the hips from specific force and rate over the fifth lumbar vertebra, in harmonics."""
    body, omega = Body(), 2.0 * np.pi * NUMBERS / stride_time
    roll, pitch, yaw = (sign * rate / (1j * omega) for sign, rate in zip((1.0, -1.0, 1.0), waves[3:], strict=True))
    x, y, z = waves[:3] - GRAVITY * np.stack([pitch, roll, np.zeros_like(roll)])
    x, y, z = (-acc / omega**2 for acc in (x, y, z))
    # The sensor is behind the hips and above them.
    x, z = x + body.back_height * pitch, z + body.back_depth * pitch
    y = y + body.back_height * roll + body.back_depth * yaw
    return np.stack([x, y, z, yaw, pitch, roll])


def harmonics() -> np.ndarray:
    """(6, 2 COUNT) the table of `recorded_pelvis`."""
    people: dict[str, list[np.ndarray]] = {}
    for name, forward in SETS.items():
        for walk in datasets.load(name):
            if len(walk.info.get("straight_parts", ())):
                people.setdefault(f"{name} {walk.recording.subject}", []).extend(strides(walk, forward))
    each = [np.array(one) for one in people.values() if one]
    means = np.array([one.mean(axis=0) for one in each])
    single = np.sqrt(np.array([(np.abs(one) ** 2).mean(axis=0) for one in each]))
    mean = means.mean(axis=0)
    waves = 2.0 * np.sqrt(np.median(single * np.abs(means), axis=0)) * mean / np.abs(mean)
    even, odd = slice(1, None, 2), slice(0, None, 2)
    rows = np.array([waves[i, even] for i in (0, 2, 4)] + [waves[i, odd] for i in (1, 3, 5)])
    for row, count in zip(rows, OWN, strict=True):
        row[:count] = 0.0
    return np.concatenate([rows.real, -rows.imag], axis=1)


def written(table: np.ndarray) -> str:
    """The text of the file."""
    lines = []
    for row in table:
        numbers = ", ".join(f"{value:.3g}" for value in row + 0.0) + ","
        lines += ["    (", textwrap.indent(textwrap.fill(numbers, 108), " " * 8), "    ),"]
    return '''"""Harmonics of the pelvis of recorded people, by `experiments.people.pelvis`; not edited by hand."""

HARMONICS = (
{}
)  # fmt: skip
"""Cosines, then sines, of twelve harmonics: forward, up [m], pitch [rad] (even); left [m], yaw, roll [rad] (odd)."""
'''.format("\n".join(lines))


def main() -> None:
    """Derive the table and write it."""
    file = Path(recorded_pelvis.__file__)
    file.write_text(written(harmonics()), encoding="utf-8")
    print(file)


if __name__ == "__main__":
    main()
