"""Sensors of both shoes that are exchanged in a pause, and exchanged back if the waist's sensor confirms it."""

from collections.abc import Sequence

import numpy as np

from jgait.estimators.combined.compare import FEWEST, OPPOSITE
from jgait.estimators.combined.sources import SourceEstimate
from jgait.estimators.combined.strides import SAME_CONTACT
from jgait.estimators.foot_ins.attached import SHOES_EXCHANGED
from jgait.notes import Kind, Note
from jgait.types import SIDES, Recording, as_float

SHOES_PUT_RIGHT = Kind(
    "shoes_put_right", "corrected", "foot_right and foot_left are exchanged from {at_s:.0f} s on: each leans in stance "
    "as the other one did before, and the contacts of the waist are on the other side; taken the other way round",
    "The sensors, or their names, have changed places in a pause.",
)  # fmt: skip


def put_right(recording: Recording, sources: Sequence[SourceEstimate]) -> tuple[Recording, list[Note]]:
    """The recording with the shoes' sensors exchanged back after they changed places, and a note if they did.

    The sides of contacts by the waist have to agree with the feet before the pause, and to be opposite after it.
    """
    by_name = {source.name: source for source in sources}
    if not {"feet", "waist"} <= by_name.keys():
        return recording, []
    feet, waist = by_name["feet"].estimate, by_name["waist"].estimate
    told = [note for note in feet.diagnostics["notes"] if note.kind is SHOES_EXCHANGED]
    pair = [recording.sensors[f"foot_{side}"] for side in SIDES if f"foot_{side}" in recording.sensors]
    if not told or len(pair) < len(SIDES) or len(pair[0].time) != len(pair[1].time):
        return recording, []
    at = float(as_float(told[0].values["at_s"])) + float(feet.time[0])
    known = np.asarray(feet.strides.valid, bool)
    ends, sides = as_float(feet.strides.end)[known], np.asarray(feet.strides.side)[known]
    sure = as_float(waist.diagnostics["initial_contact_side_probability"]) > 0.9
    contacts = as_float(waist.diagnostics["initial_contact"])[sure]
    apart = np.abs(contacts[:, None] - ends)
    near = apart.min(axis=1) < SAME_CONTACT
    opposite = sides[apart.argmin(axis=1)] != np.asarray(waist.diagnostics["initial_contact_side"])[sure]
    before, after = (opposite[near & part] for part in (contacts < at, contacts >= at))
    if min(len(before), len(after)) < FEWEST or before.mean() > 1.0 - OPPOSITE or after.mean() < OPPOSITE:
        return recording, []
    later = as_float(pair[0].time) > at
    swapped = {
        f"foot_{side}": own._replace(**{
            name: np.where(later.reshape(-1, *(1,) * (np.ndim(values) - 1)), getattr(mate, name), values)
            for name in ("gyr", "acc", "mask") if (values := getattr(own, name)) is not None
        })
        for side, own, mate in zip(SIDES, pair, pair[::-1], strict=True)
    }  # fmt: skip
    note = SHOES_PUT_RIGHT(at_s=told[0].values["at_s"])
    return recording._replace(sensors={**recording.sensors, **swapped}), [note]
