"""Undamaged walks, public and simulated, read again: notes about damage are false there."""

import contextlib
from collections import Counter
from collections.abc import Iterator

import jax

import jgait
from experiments.common import recordings
from experiments.common.row import Row, show
from experiments.common.sets import datasets
from experiments.damage.harm import read, rows_of
from jgait import simulate
from jgait.estimators.combined.crosscheck import CLOCK_OFF
from jgait.estimators.notes import RATES_OFF
from jgait.estimators.waist.notes import GYROSCOPE_CONTRADICTS, WALKING_MISSED
from jgait.io.checks import readings, walking
from jgait.mounting.places import PLACES_EXCHANGED
from jgait.notes import Kind
from jgait.quality import notes as quality_notes
from jgait.simulate.sensors import IDG300, MPU6000, OPAL
from jgait.types import Recording, RecordingError

CODES = {
    kind.code for module in (walking, readings, quality_notes)
    for kind in vars(module).values() if isinstance(kind, Kind)
} - {"channel_clipped", "channel_constant", "accelerometer_coarse", "range_lost"}  # fmt: skip
"""Codes of the readers' notes about damage."""

ANALYSED = {
    kind.code for kind in (
        RATES_OFF, GYROSCOPE_CONTRADICTS, WALKING_MISSED, PLACES_EXCHANGED, CLOCK_OFF,
    )
}  # fmt: skip
"""Codes of notes about damage that an analysis finds: rates, axes, segments and clocks."""

PEOPLE = 140
"""Simulated people for each sensor and route."""

SIMULATED = {
    "simulated, MPU-6000, straight": (MPU6000, 100.0, simulate.straight(12.0)),
    "simulated, Opal, back and forth": (OPAL, 128.0, simulate.u_turn(6.0)),
    "simulated, IDG-300, in a circle": (IDG300, 50.0, simulate.circle(2.0)),
}
"""Sensors, sampling rate [Hz] and route of simulated walks."""


def walks(quick: bool) -> Iterator[tuple[str, Recording]]:
    """Set and recording of each undamaged walk."""
    for name in datasets.list_datasets():
        if recordings.available(name):
            for walk in datasets.load(name, list(datasets.names(name))[: 3 if quick else None]):
                yield name, walk.recording
    for seed, (name, (errors, rate, way)) in enumerate(SIMULATED.items()):
        for recording, _ in simulate.cohort(
            jax.random.key(200 + seed), 3 if quick else PEOPLE, way, errors, rate, recorded=False
        ):
            yield name, recording


def rows(quick: bool) -> list[Row]:
    """Read every walk, and count the notes about damage."""
    total: Counter[str] = Counter()
    false: Counter[str] = Counter()
    analysed: Counter[str] = Counter()
    for name, recording in walks(quick):
        total[name] += 1
        try:
            again = read(rows_of(recording, tuple(recording.sensors)), recording.name)
        except RecordingError as error:
            print(f"{name}, {recording.name}: {error}")
            false[name] += 1
            continue
        found = [note.text for note in again.notes if note.code in CODES]
        false[name] += bool(found)
        more = []
        with contextlib.suppress(RecordingError):  # no estimator has its sensors, or nobody walks
            more = [note.text for note in jgait.analyse(recording).notes if note.code in ANALYSED]
        analysed[name] += bool(more)
        for text in (*found, *more):
            print(f"{name}, {recording.name}: {text}")
    columns = ["set", "walks", "with a reader's note", "with a note of the analysis"]
    show("undamaged walks", columns, [[name, total[name], false[name], analysed[name]] for name in total])
    n = sum(total.values())
    split = "public and simulated walks; thresholds were chosen on the public ones and on 456 other simulated people"
    share = Row("false_notes_pct", 100.0 * sum(false.values()) / n, "%", n=n, split=split)
    late = Row(
        "false_analysis_notes_pct", 100.0 * sum(analysed.values()) / n, "%", n=n, split="public and simulated walks"
    )
    return [
        share.on("undamaged walks with a note about damage", of="walks"),
        late.on("undamaged walks whose analysis notes rates, axes, segments or a clock", of="walks"),
    ]
