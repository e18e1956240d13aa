"""What simulated people have of recorded ones: `python -m experiments.people.shapes` derives it and writes the file.

One program after another reads `movement.json`, changes its part of it, and writes it: `pelvis`, `movement` twice,
`pelvis` again and `out_of_plane`, see there. They begin with the gait of `START`, with feet that move by the rules, and
with empty tables.

Pelvis: harmonics of the lower backs of every second person of `ipol_gait`, over strides from a contact to the next but
one, on straight parts. The angular rates give the angles; the specific force, less gravity that the tilt turns into it,
the displacements. How much people differ is that of all 12 people.

Gait, feet, sensors over bones, and styles: every second person of `walking5m`. The other people, `neura_sparse`,
`gaitmap_example` and `tripod` are people whom the simulator does not know; but `neura_sparse` has motion capture, and
shows how far sensors on thighs and shanks turn over the bone (`movement.SKIN`).
"""

import subprocess
import sys
from collections.abc import Iterator

import numpy as np
from scipy.stats import truncnorm

from experiments.common.sets import datasets
from experiments.kose2011.walks import of_set
from experiments.people import movement
from experiments.people.tables import tables, write
from jgait.geometry.vectors import GRAVITY
from jgait.simulate import Body, shapes
from jgait.types import Walk

FORWARD = (0.0, 0.0, -1.0)
"""Axis of the sensor on the lower back that points forward, in `ipol_gait`."""
PARTS_OF_STRIDE, ENDS = 96, 2
"""[1] Points of a stride at which signals are read; contacts left out at both ends of a straight part."""
STEP_TIME = (0.35, 0.9)
"""[s] Limits of the step times of strides that count."""
NUMBERS = np.arange(1, 2 * shapes.HARMONICS + 1)


ASIDE = np.array([False, True, False, True, False, True])[:, None]
"""(6, 1) bool, of specific forces forward, left, up, and of rates about these axes: whether a stride of the other foot
has the other sign."""


def harmonics(walk: Walk) -> Iterator[tuple[np.ndarray, float]]:
    """Of each stride: specific forces forward, left, up [m/s²] and rates about these axes [rad/s] in harmonics
    (6, harmonics), complex, and the stride time [s].

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
        ahead = np.asarray(FORWARD) - up * (up @ np.asarray(FORWARD))
        ahead = ahead / np.linalg.norm(ahead)
        level = np.stack([ahead, np.cross(up, ahead), up], axis=1)
        acc = np.asarray(imu.acc)[a:b] @ level * GRAVITY / gravity
        signals = np.concatenate([acc, np.asarray(imu.gyr)[a:b] @ level], axis=1).T
        for i in inside[:-2]:
            begin, middle, end = contacts[i : i + 3]
            even = sides[i] == sides[i + 2] != sides[i + 1]
            good = mask[slice(*np.searchsorted(time, [begin, end]))].all()
            if even and good and all(STEP_TIME[0] < step < STEP_TIME[1] for step in (middle - begin, end - middle)):
                half = PARTS_OF_STRIDE // 2
                steps = [np.linspace(*ends, half, endpoint=False) for ends in ((begin, middle), (middle, end))]
                at = np.concatenate(steps)
                read = np.stack([np.interp(at, time[a:b], row) for row in signals])
                waves = np.fft.rfft(read)[:, NUMBERS] / PARTS_OF_STRIDE
                yield np.where(ASIDE & (sides[i] != 1), -waves, waves), end - begin


def moved(waves: np.ndarray, stride_time: float) -> np.ndarray:
    """Motion of the middle of the hips from specific force and rate over the fifth lumbar vertebra, in harmonics:
    forward, left, up [m], yaw, pitch, roll [rad]."""
    body, omega = Body(), 2.0 * np.pi * NUMBERS / stride_time
    roll, pitch, yaw = (sign * rate / (1j * omega) for sign, rate in zip((1.0, -1.0, 1.0), waves[3:], strict=True))
    x, y, z = waves[:3] - GRAVITY * np.stack([pitch, roll, np.zeros_like(roll)])
    x, y, z = (-acc / omega**2 for acc in (x, y, z))
    # The sensor is behind the hips and above them.
    x, z = x + body.back_height * pitch, z + body.back_depth * pitch
    y = y + body.back_height * roll + body.back_depth * yaw
    return np.stack([x, y, z, yaw, pitch, roll])


MOTIONS = {"pelvis_rise": (2, 1), "pelvis_surge": (0, 1), "pelvis_sway": (1, 0), "pelvis_rotation": (3, 0),
           "pelvis_drop": (5, 0), "pelvis_nod": (4, 1)}  # fmt: skip
"""Motion of the pelvis → its row in `harmonics`, and its first harmonic."""


def spreads() -> tuple[dict[str, float], dict[str, float]]:
    """Powers of the length of the stride with which each motion of the pelvis grows, and the standard deviations
    between the people of `ipol_gait` of the logarithm of the rest.

    Printed is the power of the first harmonic with which the accelerations of the higher ones grow, beside the length.
    Differences count up to three deviations as the median absolute one states them, since one person hardly turns the
    pelvis. They are those of the normal distribution that has them when it is truncated at two deviations.
    """
    lengths = stride_lengths()
    strides = {name: motions(one) for name, one in lower_backs().items() if one and name in lengths}
    long = np.log([lengths[name] for name in strides])
    design = np.column_stack([np.ones_like(long), long])
    powers, found, higher = {}, {}, {}
    for motion, (row, harmonic) in MOTIONS.items():
        size = np.log([np.abs(one.mean(axis=0)[row, harmonic]) for one in strides.values()])
        above = slice(harmonic + 2, None, 2)
        fine = [
            np.log(np.linalg.norm(one[:, row, above] * NUMBERS[above] ** 2, axis=1).mean()) for one in strides.values()
        ]
        higher[motion] = round(float(np.linalg.lstsq(np.column_stack([design, size]), fine, rcond=None)[0][2]), 2)
        line = np.linalg.lstsq(design, size, rcond=None)[0]
        powers[motion], rest = round(float(line[1]), 2), size - design @ line
        most = 3.0 * 1.4826 * float(np.median(np.abs(rest - np.median(rest))))
        degrees = len(rest) - design.shape[1]
        found[motion] = float(np.sqrt(np.sum(np.clip(rest, -most, most) ** 2) / degrees) / truncnorm(-2.0, 2.0).std())
    print("higher harmonics grow with these powers of the first:", higher)
    return powers, found


def stride_lengths() -> dict[str, float]:
    """Person of `ipol_gait` → median length of the strides, by the sensors on the feet [m]."""
    lengths: dict[str, list[float]] = {}
    for walk in of_set("ipol_gait"):
        lengths.setdefault(f"ipol_gait {walk.subject}", []).append(float(np.median(walk.pieces.length)))
    return {name: float(np.median(each)) for name, each in lengths.items()}


def motions(strides: list[tuple[np.ndarray, float]]) -> np.ndarray:
    """(strides, 6, harmonics) of the pelvis, see `moved`."""
    return np.array([moved(*one) for one in strides])


def lower_backs() -> dict[str, list[tuple[np.ndarray, float]]]:
    """Person → harmonics and time of every stride."""
    people: dict[str, list[tuple[np.ndarray, float]]] = {}
    for walk in datasets.load("ipol_gait"):
        if len(walk.info["straight_parts"]):
            people.setdefault(f"ipol_gait {walk.recording.subject}", []).extend(harmonics(walk))
    return people


START = {
    "toe_up": 0.36, "heel_up": 1.1, "foot_flat": 0.064, "heel_off": 0.37, "swing_lift": 0.015, "landing_speed": 0.36,
    "hip_ahead": 0.01,
}  # fmt: skip
"""Parameters of the gait with which `movement` begins, see `Gait`; the feet begin as those by the rules."""
PROGRAMS = ("pelvis", "movement", "movement", "pelvis", "out_of_plane")


def main() -> None:
    """Run every program."""
    powers, spread = spreads()
    powers = {
        **dict.fromkeys((*movement.GROWS, "hip_ahead"), 1.0),
        **{name: powers[name] for name in ("pelvis_surge", "pelvis_rise")},
    }
    empty = {name: np.zeros_like(table) for name, table in tables().items() if isinstance(table, np.ndarray)}
    source = (
        "pelvis: lower backs of every second person of ipol_gait; gait, feet and skin: legs of every second person of "
        "walking5m, means, slopes and principal directions; derived by experiments.people.shapes"
    )
    write({"source": source, "gait": START, "instants": shapes.Instants()._asdict(), "powers": powers, **empty})
    print("PELVIS_SPREAD", {name: round(deviation, 2) for name, deviation in spread.items()}, flush=True)
    for program in PROGRAMS:
        print(program, flush=True)
        subprocess.run([sys.executable, "-m", f"experiments.people.{program}"], check=True)


if __name__ == "__main__":
    main()
