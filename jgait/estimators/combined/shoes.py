"""Sensors of both shoes that are exchanged in a pause, and exchanged back if the waist's sensor confirms it."""

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.combined.compare import FEWEST_COMPARED, OPPOSITE
from jgait.estimators.combined.sources import SourceEstimate
from jgait.estimators.combined.strides import SAME_CONTACT
from jgait.estimators.foot_ins.sensor import lean_notes
from jgait.estimators.stride_flags import SIDE_UNKNOWN
from jgait.notes import Kind, Note
from jgait.quality import SOUND
from jgait.types import SIDES, AnyArray, Estimate, Feet, FootTrajectory, Recording, as_float

SHOES_PUT_RIGHT = Kind(
    "shoes_put_right", "corrected", "foot_right and foot_left are exchanged from {at_s:.0f} s on: each leans in stance "
    "as the other one did before, and the contacts of the waist are on the other side; taken the other way round",
    "The sensors, or their names, have changed places in a pause.",
)  # fmt: skip


def put_right(
    recording: Recording, sources: Sequence[SourceEstimate]
) -> tuple[Recording, list[SourceEstimate], list[Note]]:
    """The recording and the sources with the shoes exchanged back after they changed places, and a note if they did.

    The sides of contacts by the waist have to agree with the feet before the pause, and to be opposite after it.
    """
    by_name = {source.name: source for source in sources}
    unchanged: tuple[Recording, list[SourceEstimate], list[Note]] = (recording, list(sources), [])
    if not {"feet", "waist"} <= by_name.keys():
        return unchanged
    feet, waist = by_name["feet"].estimate, by_name["waist"].estimate
    since = min((facts.exchanged_at for facts in feet.diagnostics["sensors"].values()), default=np.inf)
    pair = [recording.sensors[f"foot_{side}"] for side in SIDES if f"foot_{side}" in recording.sensors]
    if since == np.inf or len(pair) < len(SIDES) or len(pair[0].time) != len(pair[1].time):
        return unchanged
    at = since + float(feet.time[0])
    known = np.asarray(feet.strides.valid, bool)
    ends, sides = as_float(feet.strides.end)[known], np.asarray(feet.strides.side)[known]
    sure = as_float(waist.diagnostics["initial_contact_side_probability"]) > 0.9
    contacts = as_float(waist.diagnostics["initial_contact"])[sure]
    apart = np.abs(contacts[:, None] - ends)
    near = apart.min(axis=1) < SAME_CONTACT
    opposite = sides[apart.argmin(axis=1)] != np.asarray(waist.diagnostics["initial_contact_side"])[sure]
    before, after = (opposite[near & part] for part in (contacts < at, contacts >= at))
    if min(len(before), len(after)) < FEWEST_COMPARED or before.mean() > 1.0 - OPPOSITE or after.mean() < OPPOSITE:
        return unchanged
    swapped = {
        f"foot_{side}": _joined(imu, mate, imu.time, at)._replace(time=imu.time)
        for side, imu, mate in zip(SIDES, pair, pair[::-1], strict=True)
    }
    estimates = [
        source._replace(estimate=_exchanged(source.estimate, at)) if source.name == "feet" else source
        for source in sources
    ]
    return recording._replace(sensors={**recording.sensors, **swapped}), estimates, [SHOES_PUT_RIGHT(at_s=since)]


def _joined[R](arrays: R, mate: R, time: AnyArray, at: float) -> R:
    """The arrays (T, ...) of one side up to a time [s], and those of the other side after it."""
    later = as_float(time) > at

    def joined(array: AnyArray, other: AnyArray) -> np.ndarray:
        return np.where(later.reshape(-1, *(1,) * (np.ndim(array) - 1)), other, array)

    return jax.tree.map(joined, arrays, mate)


def _exchanged(feet: Estimate, at: float) -> Estimate:
    """The estimate of both feet, with right and left exchanged after a time [s]; paths go on where they are then."""
    row = int(np.searchsorted(as_float(feet.time), at, side="right"))

    def path(trajectory: PyTree, mate: PyTree) -> FootTrajectory:
        there = min(row, len(trajectory.position) - 1)
        shifted = mate._replace(position=mate.position + (trajectory.position[there] - mate.position[there]))
        joined: FootTrajectory = _joined(trajectory, shifted, feet.time, at)
        return joined

    diagnostics = {name: value for name, value in feet.diagnostics.items() if name != SIDE_UNKNOWN.name}
    for side, other in (SIDES, SIDES[::-1]):
        pitch = [feet.diagnostics[f"pitch_{foot_side}"] for foot_side in (side, other)]
        diagnostics[f"pitch_{side}"] = _joined(pitch[0], pitch[1], feet.time, at)
        footholds, mate = (np.asarray(feet.diagnostics[f"footholds_{foot_side}"]) for foot_side in (side, other))
        diagnostics[f"footholds_{side}"] = np.concatenate([footholds[footholds < row], mate[mate >= row]])
    leans = lean_notes(diagnostics["sensors"])
    diagnostics["notes"] = tuple(note for note in diagnostics["notes"] if note not in leans)
    diagnostics["sensors"] = {
        name: facts._replace(leans_at=SOUND.leans_at, leans_deg=SOUND.leans_deg, exchanged_at=SOUND.exchanged_at)
        for name, facts in diagnostics["sensors"].items()
    }
    sides = np.where(as_float(feet.strides.end) > at, 1 - np.asarray(feet.strides.side), feet.strides.side)
    paths: PyTree = feet.feet
    spread: PyTree = feet.feet_stddev
    deviations: PyTree = feet.strides_stddev
    return feet._replace(
        strides=feet.strides._replace(side=sides), strides_stddev=deviations._replace(side=sides),
        feet=Feet(path(*paths), path(*paths[::-1])),
        feet_stddev=Feet(*(_joined(deviation, mate, feet.time, at) for deviation, mate in (spread, spread[::-1]))),
        diagnostics=diagnostics,
    )  # fmt: skip
