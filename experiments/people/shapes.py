"""The tables of `jgait.simulate.shapes`: `python -m experiments.people.shapes` derives them and writes the file.

Pelvis: harmonics of the lower back of the 12 people of `ipol_gait` and of one of `mobgap_lab`, over strides from a
contact to the next but one, on straight parts. The angular rates give the angles; the specific force, less gravity
that the tilt turns into it, the displacements. Phases, and the shares of the motions of a harmonic, are those of the
mean over people. Its size is the median over people, between that of the mean stride (which jitter blurs) and that of
single strides (which includes noise).

Feet, skin in the plane of the leg and styles: `movement` fits them to every second person of `walking5m`, around these
and the present values.
The fit starts from the present values, so that another run moves them a little further. The numbers in the package are
not the output of one run: after the fit the first harmonic of the pelvis' pitch, in whose phase people differ, was
raised to the median size of people. The fit makes people too much alike: the styles of the skin's pitch were multiplied
by 1.7 at thighs and 2.35 at shanks, so that rates differ between people as those of the fit do in harmonics 4 to 10.
After that `pelvis` and `out_of_plane` were run: they add to the means what the usual person lacks. The other people,
`neura_sparse`, `gaitmap_example` and `tripod` are people whom the simulator does not know.
"""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import jax
import numpy as np

from experiments.kose2011.walks import of_set
from experiments.people import movement
from jgait import datasets
from jgait.geometry.vectors import GRAVITY
from jgait.simulate import RECORDED, Body, shapes
from jgait.types import Walk

FILE = Path(shapes.__file__).with_name("movement.json")
SETS = {"ipol_gait": (0.0, 0.0, -1.0), "mobgap_lab": (0.0, 0.0, 1.0)}
"""Sets of the pelvis → the axis of the sensor on the lower back that points forward."""
PARTS_OF_STRIDE, ENDS = 96, 2
"""[1] Points of a stride at which signals are read; contacts left out at both ends of a straight part."""
STEP_TIME = (0.35, 0.9)
"""[s] Limits of the step times of strides that count."""
NUMBERS = np.arange(1, 2 * shapes.HARMONICS + 1)


ASIDE = np.array([False, True, False, True, False, True])[:, None]
"""(6, 1) bool, of specific forces forward, left, up, and of rates about these axes: whether a stride of the other foot
has the other sign."""


def harmonics(walk: Walk, forward: tuple[float, float, float]) -> Iterator[tuple[np.ndarray, float]]:
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


LEVER = np.array([1.0, 1.0, 0.3])[:, None]
"""[m] A turn of the pelvis by one radian counts as much as this motion."""
LARGEST = 3.0
"""[1] Largest size of a harmonic over that of the mean stride of all people."""


MOTIONS = {"pelvis_rise": (2, 1), "pelvis_surge": (0, 1), "pelvis_sway": (1, 0), "pelvis_rotation": (3, 0),
           "pelvis_drop": (5, 0), "pelvis_nod": (4, 1)}  # fmt: skip
"""Motion of the pelvis → its row in `harmonics`, and its first harmonic."""


def spreads() -> dict[str, float]:
    """Standard deviations between the people of `ipol_gait` of the logarithm of each motion, after a power of the
    length of the stride was taken off; from the median absolute deviation, since one person hardly turns the pelvis."""
    lengths = stride_lengths()
    strides = {name: motions(one) for name, one in lower_backs(("ipol_gait",)).items() if one and name in lengths}
    long = np.log([lengths[name] for name in strides])
    design = np.column_stack([np.ones_like(long), long])
    found = {}
    for motion, (row, harmonic) in MOTIONS.items():
        size = np.log([np.abs(one.mean(axis=0)[row, harmonic]) for one in strides.values()])
        rest = size - design @ np.linalg.lstsq(design, size, rcond=None)[0]
        found[motion] = 1.4826 * float(np.median(np.abs(rest - np.median(rest))))
    return found


def stride_lengths() -> dict[str, float]:
    """Person of `ipol_gait` → median length of the strides, by the sensors on the feet [m]."""
    lengths: dict[str, list[float]] = {}
    for walk in of_set("ipol_gait"):
        lengths.setdefault(f"ipol_gait {walk.subject}", []).append(float(np.median(walk.pieces.length)))
    return {name: float(np.median(each)) for name, each in lengths.items()}


def motions(strides: list[tuple[np.ndarray, float]]) -> np.ndarray:
    """(strides, 6, harmonics) of the pelvis, see `moved`."""
    return np.array([moved(*one) for one in strides])


def lower_backs(names: Sequence[str] = tuple(SETS)) -> dict[str, list[tuple[np.ndarray, float]]]:
    """Person → harmonics and time of every stride."""
    people: dict[str, list[tuple[np.ndarray, float]]] = {}
    for name in names:
        for walk in datasets.load(name):
            if len(walk.info.get("straight_parts", ())):
                people.setdefault(f"{name} {walk.recording.subject}", []).extend(harmonics(walk, SETS[name]))
    return people


def pelvis() -> tuple[np.ndarray, np.ndarray]:
    """(6, 2 HARMONICS) the table of the pelvis around which the fit begins, and the deviations between people (6,
    HARMONICS)."""
    strides = [motions(one) for one in lower_backs().values() if one]
    means = np.array([one.mean(axis=0) for one in strides])
    single = np.sqrt(np.array([(np.abs(one) ** 2).mean(axis=0) for one in strides]))
    tables, deviations = [], []
    for rows, which in (([0, 2, 4], slice(1, None, 2)), ([1, 3, 5], slice(0, None, 2))):
        own, size = means[:, rows, which], single[:, rows, which]
        mean = own.mean(axis=0)
        usual = np.median(np.sum(size * np.abs(own) * LEVER**2, axis=1), axis=0)
        # One factor for a harmonic: force and turn of a lower back keep their ratio.
        factor = np.sqrt(usual / np.sum(np.abs(mean) ** 2 * LEVER**2, axis=0))
        waves = 2.0 * mean * np.minimum(factor, LARGEST)
        tables.append(np.concatenate([waves.real, -waves.imag], axis=1))
        deviations.append(2.0 * own.std(axis=0))
    return np.concatenate(tables), np.concatenate(deviations)


def written(source: str, tables: dict[str, np.ndarray]) -> str:
    """The text of the file."""
    lines = [f' "source": {json.dumps(source)}']
    for name, table in tables.items():
        blocks = [
            "  [" + ",\n   ".join(json.dumps([float(f"{value:.4g}") for value in row]) for row in block) + "]"
            for block in table
        ]
        lines.append(f' "{name}": [\n' + ",\n".join(blocks) + "\n ]")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def main() -> None:
    """Derive the tables, write the file, and print the other numbers of the fit, which stand in the code."""
    table, spread = pelvis()
    base = movement.Base(shapes.FEET[0], table, spread)
    known = [one for one, _ in movement.known().values()]
    people = movement.targets(known)
    values = movement.fit(people, base)
    directions = movement.styles(people, base, values, len(shapes.STYLES))
    factors, *mean = movement.free(values[0], base)
    blocks = [mean] + [
        [moved - part for moved, part in zip(movement.free(values[0] + one, base)[1:], mean, strict=True)]
        for one in (*values[1:], *directions)
    ]
    feet, hips, skin = (np.array([np.asarray(block[i]) for block in blocks]) for i in range(3))
    hips[:, 1] *= float(factors["pelvis_rise"])
    aside = np.arange(skin.shape[1]) % len(shapes.WORN) >= len(movement.SKIN)  # see `out_of_plane`
    skin[:, aside] = shapes.SKIN[:, aside]
    source = (
        "means, slopes and principal directions; pelvis: lower backs of every second person of ipol_gait; feet and "
        f"skin: legs of {len(known)} people ({sum(one.strides for one in known)} strides) of walking5m; derived by "
        "experiments.people.shapes, pelvis and out_of_plane"
    )
    FILE.write_text(written(source, {"pelvis": hips, "feet": feet, "skin": skin}), encoding="utf-8")
    for number, (name, factor) in enumerate(factors.items()):
        power = float(values[1, number]) * movement.GAIT[name] / shapes.UNIT
        new = float(getattr(RECORDED, name) * factor)
        print(f"RECORDED.{name} = {new:.3g}; power of the stride, in addition: {power:+.2f}")
    print("PELVIS_SPREAD", {name: round(deviation, 2) for name, deviation in spreads().items()})
    print(FILE)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
