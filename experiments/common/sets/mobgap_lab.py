"""`mobgap_lab`: lower back, 100 Hz, with motion capture and with the INDIP system (the Mobilise-D consortium's mobgap).

Recordings are named `<cohort>/<participant>/<test>/<trial>`. `Test5` is a straight walk, `Test11` a circuit of daily
activities with short bouts and turns. Upstream has more participants than this version of jgait can fetch; all
`<cohort>/<participant>/data.mat` in the folder are read. Upstream g and deg/s. Axes kept: x up, y right, z forwards.

Reference: contacts, strides and walking bouts by motion capture (`Stereophoto`) and by insoles, foot sensors and
distance sensors (`INDIP`); the walk's reference is the motion capture, or the INDIP where the motion capture has no
bout, and both are in `systems`. Upstream counts samples from 1 and writes times as count / rate; here every time is on
the sensor's clock, which begins with 0, and is one sample less. Upstream's strides are in seconds (`Stereophoto`) or in
counts (`INDIP`). A contact without a known time is NaN upstream and left out here; upstream's stride over such a
contact consists of two strides, and is not `valid` here. A bout's distance is upstream's `Length` (the motion capture's
is the sum of its step lengths); `distance_feet` is the motion capture's `LengthFeet`, which differs by up to 11 % and
is known for some bouts without a `Length`. A bout's speed is the mean of its strides' speeds, and not its distance over
its time.

Keys of `Walk.info`; empty or None where unknown:
    initial_contacts, initial_contact_sides: (n,) [s], and 0 right, 1 left; in order of time.
    initial_contact_bouts: (n,) number of the bout of each initial contact.
    final_contacts, final_contact_sides: (m,) likewise.
    bouts: {"start", "end" [s], "distance", "distance_feet" [m], "speed" [m/s], "cadence" [steps/s], "straight" (bool),
        "unseen_contacts" (int): (b,)}, each from its first contact to its last; NaN where not given. `straight`:
        upstream detected no turn in the bout; `unseen_contacts`: number of initial contacts without a time.
    turns: {"start", "end" [s], "angle" [rad], left positive: (k,)} inside bouts. Take the sign from the gyroscope: in
        HA/001 and HA/002 the sign is wrong in 1 of 13 turns of the motion capture and in 7 of 10 of the INDIP.
    straight_parts: (p, 2) [s] the bouts without a turn.
    trial: (start, end) [s] of the recording.
    test, trial_name: "Test5", "Trial1". straight: whether the test is a straight walk.
    height, sensor_height [m], mass [kg]: None where not given.
    reference_system: "Stereophoto", "INDIP" or None; the system of all of the above.
    systems: name → the keys from `initial_contacts` to `straight_parts`, and "strides" (`Strides`), of each system that
        recorded a bout.
    no_reference: why there is no reference; None where there is one.
    verified: whether every file's sha256 was known and agreed.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import PyTree

from experiments.common.sets.xio_gait import UNITS_CONVERTED
from jgait.datasets import registry
from jgait.datasets.reading import Files, foot_imu
from jgait.geometry.vectors import GRAVITY
from jgait.io.formats.matlab import read_matlab
from jgait.notes import AS_READ, DATA_LOST, LEFT_OUT, Kind, Note
from jgait.types import SIDES, AnyArray, Estimate, Imu, Legs, Recording, RecordingError, Strides, Walk

ROOT = "example_data/data/lab"
SYSTEMS = ("Stereophoto", "INDIP")
LEVEL = "MicroWB"  # upstream's walking bout; a ContinuousWalkingPeriod may contain several, with breaks
USUAL = "TimeMeasure1"  # the only time of measurement upstream; any other one becomes part of the name
STRAIGHT_TESTS = ("Test5",)
COUNTS = 10.0  # [1] strides that end later than so many times the end of their bout are in counts, not in seconds
BOUT = {
    "start": "Start",
    "end": "End",
    "distance": "Length",
    "distance_feet": "LengthFeet",
    "speed": "WalkingSpeed",
    "cadence": "Cadence",
}
PERSON = {"height": ("Height", 0.01), "sensor_height": ("SensorHeight", 0.01), "mass": ("Weight", 1.0)}
COUNTED_FROM_ONE = Kind(
    "counted_from_one",
    "info",
    "times of the reference are one sample earlier than upstream's, which counts from 1",
    AS_READ.meaning,
)
STAMPS_UNEVEN = Kind(
    "stamps_uneven",
    "info",
    "upstream's time stamps differ from sample / {rate_hz:.0f} Hz by more than half a sample",
    AS_READ.meaning,
)
BOUTS_LEFT_OUT = Kind(
    "bouts_left_out", "info", "{system}: {left_out} of {bouts} bouts left out, outside the recording", LEFT_OUT.meaning
)
CONTACTS_LEFT_OUT = Kind(
    "contacts_left_out",
    "info",
    "{bout}: {left_out} of {contacts} {kind} contacts left out: no time, twice the same, or outside",
    LEFT_OUT.meaning,
)
PERSON_UNKNOWN = Kind("person_unknown", "info", "measures of the person are not known: {reason}", LEFT_OUT.meaning)
STRIDES_LEFT_OUT = Kind(
    "strides_left_out", "info", "{bout}: strides left out, as they do not begin with the contacts", LEFT_OUT.meaning
)


def names() -> list[str]:
    """Trials on this computer, for example 'HA/001/Test5/Trial1'; the participant if its trials cannot be listed."""
    walks = []
    for file in registry.listing("mobgap_lab", ROOT, "data.mat"):
        participant = Path(file).parent.relative_to(ROOT).as_posix()
        if participant.count("/") == 1:
            walks += [f"{participant}/{trial}" for trial in _trials(participant)] or [participant]
    return walks


def load_one(name: str) -> Walk:
    """One trial with its references."""
    participant, key = "/".join(name.split("/")[:2]), name.split("/")[2:]
    files = Files("mobgap_lab", UNITS_CONVERTED(), COUNTED_FROM_ONE())
    notes, tree = files.notes, read_matlab(files.need(f"{ROOT}/{participant}/data.mat"), ("data",), simplify_cells=True)
    if len(key) not in (2, 3):
        raise RecordingError(f"{participant}/data.mat holds no trial")
    measure, test, trial = key if len(key) == 3 else (USUAL, *key)
    sensor = _descend(tree, f"{participant}/data.mat", "data", measure, test, trial)
    imu, rate = _sensor(sensor, name, notes)
    systems, why = {}, []
    for system in SYSTEMS:
        bouts = _as_list(sensor.get("Standards", {}).get(system, {}).get(LEVEL, []))
        if bouts:
            systems[system] = _system(bouts, system, rate, float(imu.time[-1]), notes)
        else:
            why.append(f"{system} saw no walking bout")
    chosen = next(iter(systems), None)
    person = _person(participant, measure, files)
    reference = systems[chosen] if chosen else _system([], "", rate, float(imu.time[-1]), notes)
    details = {key: value for key, value in reference.items() if key != "strides"} | person
    details |= {
        "trial": (float(imu.time[0]), float(imu.time[-1])), "test": test, "trial_name": trial,
        "straight": test in STRAIGHT_TESTS, "reference_system": chosen, "systems": systems,
        "no_reference": None if chosen else "; ".join(why), "verified": files.verified,
    }  # fmt: skip
    recording = Recording({"lower_back": imu}, rate, name, participant, tuple(notes))
    return Walk(recording, _reference(imu.time, reference, chosen) if chosen else None, details)


def _trials(participant: str) -> list[str]:
    """'Test5/Trial1', … by upstream's list, which needs no SciPy, else by the data; empty if both files are missing."""
    try:
        path, _ = registry.file("mobgap_lab", f"{ROOT}/{participant}/test_list.json", strict=False)
        keys = [tuple(map(str, entry["key"])) for entry in json.loads(path.read_text())["data"]]
    except (registry.DatasetUnavailable, ValueError, KeyError, TypeError):
        try:
            path, _ = registry.file("mobgap_lab", f"{ROOT}/{participant}/data.mat")
            measures = read_matlab(path, ("data",), simplify_cells=True)["data"]
            keys = [(measure, test, trial) for measure, of in measures.items() for test in of for trial in of[test]]
        except (ImportError, ValueError, TypeError, AttributeError):  # the error is reported when the trial is loaded
            return []
    return ["/".join(key[1:] if key[0] == USUAL else key) for key in keys]


def _descend(tree: PyTree, file: str, *keys: str) -> PyTree:
    for key in keys:
        if not isinstance(tree, dict) or key not in tree:
            there = [name for name in tree if not name.startswith("_")] if isinstance(tree, dict) else []
            raise RecordingError(f"{file} has no {key}; it has {', '.join(there) or 'nothing'}")
        tree = tree[key]
    return tree


def _as_list(bouts: PyTree) -> list[dict[str, PyTree]]:
    """List of structs, from a struct, an array of structs, or an empty array."""
    return [bouts] if isinstance(bouts, dict) else [bout for bout in bouts if isinstance(bout, dict)]


def _sensor(content: dict[str, Any], name: str, notes: list[Note]) -> tuple[Imu, float]:
    sensor = _descend(content, name, "SU", "LowerBack")
    rates = _descend(sensor, name, "Fs")
    acc, gyr = (np.asarray(_descend(sensor, name, signal), np.float64) for signal in ("Acc", "Gyr"))
    rate = float(_descend(rates, name, "Acc"))
    if rate != rates.get("Gyr") or not rate > 0:
        raise RecordingError(f"{name}: accelerometer and gyroscope must share a rate; {rate} and {rates.get('Gyr')} Hz")
    imu, _ = foot_imu(name, np.arange(len(acc)) / rate, np.deg2rad(gyr), acc * GRAVITY)
    if not imu.mask.all():
        notes.append(DATA_LOST.note(f"samples masked: {(~imu.mask).sum()} of {len(acc)}", placement="lower_back"))
    stamps = np.atleast_1d(sensor.get("Timestamp", np.zeros(0)))
    if len(stamps) == len(acc) and np.abs(stamps - stamps[0] - imu.time).max() > 0.5 / rate:
        notes.append(STAMPS_UNEVEN(rate_hz=rate))
    return imu, rate


def _system(bouts: list[dict[str, PyTree]], system: str, rate: float, last: float, notes: list[Note]) -> dict[str, Any]:
    """What one system measured: the keys of `Walk.info` up to `straight_parts`, and strides; times less one sample."""
    shift = 1.0 / rate
    whole = [bout for bout in bouts if 0.0 < _number(bout, "Start") < _number(bout, "End") < last + 1.5 * shift]
    if len(whole) < len(bouts):
        notes.append(BOUTS_LEFT_OUT(system=system, left_out=len(bouts) - len(whole), bouts=len(bouts)))
    parts: dict[str, list[np.ndarray]] = {
        "ic": [np.zeros((0, 3))],
        "fc": [np.zeros((0, 3))],
        "turn": [np.zeros((0, 3))],
    }
    strides, unseen = [np.zeros((0, 7))], []
    for number, bout in enumerate(whole):
        where = f"{system}, bout {number}"
        contacts, final = (_events(bout, f"{event}Contact", where) for event in ("Initial", "Final"))
        strides.append(_strides(bout, contacts, final, rate, where, notes))
        unseen.append(int(np.isnan(contacts[:, 0]).sum()))
        for key, events, until in (("ic", contacts, _number(bout, "End")), ("fc", final, last + shift)):
            keep = (events[:, 0] > shift / 2) & (events[:, 0] < until + shift / 2)
            kept = np.unique(events[keep], axis=0) - [shift, 0.0]
            if len(kept) < len(events):
                kind = "initial" if key == "ic" else "final"
                left_out = len(events) - len(kept)
                notes.append(CONTACTS_LEFT_OUT(bout=where, left_out=left_out, contacts=len(events), kind=kind))
            parts[key].append(np.concatenate([kept, np.full((len(kept), 1), number)], axis=1))
        turns = [_numbers(bout, f"Turn_{key}", where) for key in ("Start", "End", "Angle")]
        parts["turn"].append(np.stack([turns[0] - shift, turns[1] - shift, np.deg2rad(turns[2])], axis=1))
    ic, fc, turn = (np.concatenate(of)[np.argsort(np.concatenate(of)[:, 0], kind="stable")] for of in parts.values())
    table = {ours: np.array([_number(bout, theirs) for bout in whole]) for ours, theirs in BOUT.items()}
    table |= {"start": table["start"] - shift, "end": table["end"] - shift, "cadence": table["cadence"] / 60.0}
    table["unseen_contacts"] = np.array(unseen, np.int64)
    straight = np.array([_number(bout, "Turning_Flag") == 0 for bout in whole], bool)
    side, start, toes, end, length, step, valid = np.concatenate(strides).T
    unknown = np.full(len(side), np.nan)
    return {
        "initial_contacts": ic[:, 0], "initial_contact_sides": ic[:, 1].astype(np.int64),
        "initial_contact_bouts": ic[:, 2].astype(np.int64),
        "final_contacts": fc[:, 0], "final_contact_sides": fc[:, 1].astype(np.int64),
        "bouts": {**table, "straight": straight},
        "turns": {"start": turn[:, 0], "end": turn[:, 1], "angle": turn[:, 2]},
        "straight_parts": np.stack([table["start"], table["end"]], axis=1)[straight],
        "strides": Strides(
            side.astype(np.int64), start - shift, toes - shift, end - shift, length, unknown, unknown, valid > 0,
            speed=length / (end - start), step_length=step,
        ),
    }  # fmt: skip


def _number(bout: dict[str, Any], key: str) -> float:
    """A number of the bout; NaN where upstream has an empty array or lacks the key."""
    values = np.asarray(bout.get(key, []), np.float64).ravel()
    return float(values[0]) if values.size else np.nan


def _numbers(bout: dict[str, Any], key: str, where: str) -> np.ndarray:
    try:
        return np.asarray(bout.get(key, []), np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{where}: {key} must be numbers: {error}") from error


def _events(bout: dict[str, Any], event: str, where: str) -> np.ndarray:
    """(n, 2): upstream's time [s], NaN where unknown, and side."""
    time = _numbers(bout, f"{event}_Event", where)
    labels = [str(label).lower() for label in np.atleast_1d(bout.get(f"{event}_LeftRight", []))]
    if len(labels) != len(time) or not set(labels) <= set(SIDES):
        raise RecordingError(f"{where}: {event}_LeftRight must be Left or Right for each of {len(time)} events")
    return np.stack([time, [SIDES.index(label) for label in labels]], axis=1)


def _strides(
    bout: dict[str, Any], contacts: np.ndarray, final: np.ndarray, rate: float, where: str, notes: list[Note]
) -> np.ndarray:
    """(n, 7): side, start, final contact, end [s], length, step length [m], valid; row k begins with contact k."""
    borders = _numbers(bout, "Stride_InitialContacts", where).reshape(-1, 2)
    if np.isfinite(borders).any() and np.nanmax(borders) > COUNTS * _number(bout, "End"):
        borders = borders / rate
    count = len(borders)
    late = borders[:, 0] - contacts[:count, 0] if count <= len(contacts) else np.full(1, np.inf)
    if np.any(np.abs(late) > 0.5 / rate):
        notes.append(STRIDES_LEFT_OUT(bout=where))
        return np.zeros((0, 7))
    length = _numbers(bout, "Stride_Length", where)
    step = _numbers(bout, "Step_Length", where)
    step = step if len(step) == len(contacts) - 1 else np.full(count, np.nan)
    rows = []
    for k, (start, end) in enumerate(borders):
        side = contacts[k, 1]
        after = contacts[k + 1 :][contacts[k + 1 :, 1] == side]
        next_one = len(after) > 0 and abs(after[0, 0] - end) < 0.5 / rate
        toes = final[k, 0] if len(final) == count else np.nan
        rows.append([side, start, toes, end, length[k] if len(length) == count else np.nan, step[k], next_one])
    table = np.array(rows).reshape(-1, 7)
    return table[np.isfinite(table[:, [1, 3]]).all(axis=1)]


def _reference(time: AnyArray, details: dict[str, Any], system: str) -> Estimate:
    """Distance along the bouts, linear in time within each bout; valid inside bouts with a known length."""
    bouts = details["bouts"]
    known = np.isfinite(bouts["distance"])
    start, end = bouts["start"][known], bouts["end"][known]
    walked = np.concatenate([[0.0], np.cumsum(bouts["distance"][known])])
    corners = np.concatenate([[time[0]], np.stack([start, end], axis=1).ravel()])
    distance = np.interp(time, corners, np.concatenate([[0.0], np.repeat(walked, 2)[1:-1]]))
    valid = np.any((time[:, None] >= start) & (time[:, None] <= end), axis=1)
    source = {"source": f"{system}: length of each bout"}
    return Estimate(time, Legs(None, None), None, distance, valid, source, details["strides"])


def _person(participant: str, measure: str, files: Files) -> dict[str, float | None]:
    """Body measures; None where unknown."""
    about: dict[str, Any] = {}
    path = files.find(f"{ROOT}/{participant}/infoForAlgo.mat")
    try:
        if path is not None:
            content = read_matlab(path, ("infoForAlgo",), simplify_cells=True)
            about = _descend(content, f"{participant}/infoForAlgo.mat", "infoForAlgo", measure)
    except RecordingError as error:
        files.notes.append(PERSON_UNKNOWN(reason=error))
    measures = {ours: _number(about, theirs) * factor for ours, (theirs, factor) in PERSON.items()}
    return {ours: value if np.isfinite(value) else None for ours, value in measures.items()}
