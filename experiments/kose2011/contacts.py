"""Initial contacts found at the lower back beside those of the reference, for any detector."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from experiments.common.matching import f1, nearest
from experiments.common.row import Row, show
from experiments.kose2011.walks import SETS, Walk, Windows, inside, sets
from jgait.estimators import waist as waist_ofdri
from jgait.estimators.waist import DEFAULT
from jgait.estimators.waist import params as waist_params
from jgait.events.trunk import PaperRule, Peaks

TOLERANCE = 0.2
"""[s] Between a detection and a contact, after the set's median offset is taken off."""

FAR = 0.3
"""[s] Detections farther from a contact are not used for the offset."""

DETECTORS = ("soft", "peaks", "paper", "literal")
waist_params.DETECTORS.update(peaks=Peaks(), literal=PaperRule(relative_to="max", hard=True))
"""Those that only this table compares: the baseline, and the paper by the letter, with maxima and hard thresholds."""


class Found(NamedTuple):
    """Contacts that a detector found in one walk: times [s], in order, sides (0 right, 1 left), and whether each side
    is stated; None: every side is."""

    time: np.ndarray
    side: np.ndarray
    known: np.ndarray | None = None


class Matched(NamedTuple):
    """Detections beside contacts.

    Attributes:
        late: (hits,) detection less contact [s], nothing taken off.
        right: (hits,) bool, the side is right.
        known: (hits,) bool, the side is stated.
        missed: contacts that were not found.
        extra: detections without a contact.
    """

    late: np.ndarray
    right: np.ndarray
    known: np.ndarray
    missed: int
    extra: int


def detected(walk: Walk, detector: str = DEFAULT.detector) -> Found:
    """The contacts of the estimator: as `waist_ofdri.estimate` gives them, without measuring distances."""
    inputs = waist_ofdri.prepared(walk.recording, DEFAULT._replace(detector=detector)).inputs
    rows = np.flatnonzero(np.asarray(inputs.contacts)[: int(inputs.count)])
    time, side, likely = (np.asarray(x)[rows] for x in (inputs.contact, inputs.side, inputs.likely))
    return Found(time, side, likely >= waist_ofdri.SIDE_KNOWN)


def lateness(walk: Walk, found: Found, windows: Windows) -> np.ndarray:
    """(n,) [s] how late the nearest detection is for each contact that is looked for, those far from any left out."""
    looked = walk.contacts[inside(walk.contacts, windows.looked)]
    if not len(found.time):
        return np.zeros(0)
    late = found.time[None, :] - looked[:, None]
    late = late[np.arange(len(looked)), np.abs(late).argmin(axis=1)]
    return late[np.abs(late) < FAR]


def matched(walk: Walk, found: Found, windows: Windows, offset: float) -> Matched:
    """Detections beside all contacts of a walk, counted where they are looked for or judged."""
    joined = nearest(found.time - offset, walk.contacts, TOLERANCE)
    looked, judged = inside(walk.contacts, windows.looked), inside(found.time - offset, windows.judged)
    hits = [(i, j) for i, j in joined if looked[j]]
    used = {i for i, _ in joined}
    extra = sum(bool(judged[i]) and i not in used for i in range(len(found.time)))
    late = np.array([found.time[i] - walk.contacts[j] for i, j in hits])
    right = np.array([found.side[i] == walk.sides[j] for i, j in hits], bool)
    stated = np.ones(len(found.time), bool) if found.known is None else found.known
    return Matched(late, right, stated[[i for i, _ in hits]], int(looked.sum()) - len(hits), extra)


class Score(NamedTuple):
    """Contacts of a set.

    Attributes:
        f1: of all walks together [1].
        mae: mean absolute error with the median offset of the other people [ms].
        sd: of the errors about it [ms].
        plain: mean absolute error as the detector comes [ms].
        offset: the set's median [ms].
        sides: contacts found with a stated side whose side is right [%].
        answered: contacts found with a stated side [%].
        missed: contacts that were not found.
        extra: detections without a contact.
        n: contacts looked for.
    """

    f1: float
    mae: float
    sd: float
    plain: float
    offset: float
    sides: float
    answered: float
    missed: int
    extra: int
    n: int


def score(walks: Sequence[Walk], founds: Sequence[Found], whole: bool = False) -> Score:
    """All walks of a set; offsets are learned on everybody but the person they are taken off."""
    windows = [walk.whole if whole else walk.straight for walk in walks]
    of = list(zip(walks, founds, windows, strict=True))
    late = [lateness(*one) for one in of]
    offset = float(np.median(np.concatenate(late)))
    each = [matched(*one, offset) for one in of]
    errors = []
    for walk, one in zip(walks, each, strict=True):
        others = [told for told, other in zip(late, walks, strict=True) if other.subject != walk.subject]
        if others:
            errors.append(one.late - np.median(np.concatenate(others)))
    hits = sum(one.late.size for one in each)
    missed, extra = (sum(getattr(one, name) for one in each) for name in ("missed", "extra"))
    held = np.concatenate(errors) if errors else np.full(1, np.nan)
    every, right, known = (np.concatenate([getattr(one, name) for one in each]) for name in ("late", "right", "known"))
    return Score(
        f1(hits, missed, extra), 1000.0 * float(np.mean(np.abs(held))),
        1000.0 * float(np.std(held)), 1000.0 * float(np.mean(np.abs(every))), 1000.0 * offset,
        100.0 * float(np.mean(right[known])), 100.0 * float(np.mean(known)), missed, extra, hits + missed,
    )  # fmt: skip


def reference_sd(walks: Sequence[Walk], founds: Sequence[Found]) -> float:
    """Standard deviation of the error of the reference's contacts [s], by a three-cornered hat.

    Errors of the reference, of the waist and of the sensors on the feet are taken to be independent. Means and a
    linear growth with the step time are no error. Where a person has looked at the signals of the feet, errors of these
    two have the same sign, and the reference errs by more.
    """
    rows = []
    for walk, found in zip(walks, founds, strict=True):
        assert walk.landed is not None
        looked, step = inside(walk.contacts, walk.straight.looked), float(np.median(np.diff(found.time)))
        rows += [(found.time[i], walk.contacts[j], walk.landed[j], step)
                 for i, j in nearest(found.time, walk.contacts, TOLERANCE) if looked[j]]  # fmt: skip
    waist, reference, feet, step = np.array([row for row in rows if np.isfinite(row).all()]).T

    def apart(one: np.ndarray, other: np.ndarray) -> float:
        late = one - other
        near = np.abs(late - np.median(late)) < 0.5 * TOLERANCE
        return float(np.var(late[near] - np.polyval(np.polyfit(step[near], late[near], 1), step[near])))

    return float(np.sqrt(0.5 * max(apart(waist, reference) + apart(feet, reference) - apart(waist, feet), 0.0)))


def line(title: str, s: Score) -> list[Any]:
    """Of a table."""
    return [title, f"{s.f1:.3f}", s.missed, s.extra, s.n, f"{s.mae:.0f}", f"{s.sd:.0f}", f"{s.plain:.0f}",
            f"{s.offset:+.0f}", f"{s.sides:.1f} of {s.answered:.1f}"]  # fmt: skip


COLUMNS = [
    "",
    "F1",
    "missed",
    "extra",
    "n",
    "MAE [ms]",
    "SD",
    "as it comes",
    "offset [ms]",
    "sides right, of [%]",
]


def rows_of(name: str, s: Score) -> list[Row]:
    """The rows of a detector on a set; `name` is the set's name and a suffix for the detector."""
    split = "offset of the other people"
    hits = s.n - s.missed
    found = [
        Row(f"ic_f1_{name}", s.f1, "F1", n=s.n, split="0.2 s about the set's median offset"),
        Row(f"ic_mae_ms_{name}", s.mae, "ms", n=hits, split=split),
        Row(f"ic_sd_ms_{name}", s.sd, "ms", n=s.n - s.missed, split=split),
        Row(f"ic_mae_no_offset_ms_{name}", s.plain, "ms", n=s.n - s.missed, split="as the detector comes"),
        Row(f"ic_side_pct_{name}", s.sides, "%", n=hits, split="where it answers"),
        Row(f"ic_side_answered_pct_{name}", s.answered, "%", n=hits),
    ]
    return [
        row.on(of_set(name)[row.metric], "default", "contacts") if row.metric in of_set(name) else row for row in found
    ]


def of_set(name: str) -> dict[str, str]:
    """Metric → its line of the table of all experiments, for the default detector on straight walks."""
    if name not in SETS:
        return {}
    return {
        f"ic_f1_{name}": f"initial contacts on straight walks, `{name}`: F1",
        f"ic_mae_ms_{name}": f"time of initial contacts, offset learned on other people, `{name}`: MAE",
        f"ic_side_pct_{name}": f"left and right of initial contacts, `{name}`: correct where stated",
        f"ic_side_answered_pct_{name}": f"left and right of initial contacts, `{name}`: stated",
    }


def rows(quick: bool) -> list[Row]:
    """On the sets that are here."""
    chosen = sets(quick)
    return of_sets(chosen, quick) if chosen else []


def of_sets(sets: dict[str, list[Walk]], quick: bool) -> list[Row]:
    """Every detector on every set: straight walking, and where there are turns the whole walks."""
    found, lines = [], []
    for name, walks in sets.items():
        for detector in DETECTORS[:1] if quick else DETECTORS:
            founds = [detected(walk, detector) for walk in walks]
            suffix = "" if detector == DEFAULT.detector else f"_{detector}"
            for whole in (False, True) if name == "ipol_gait" else (False,):
                told = score(walks, founds, whole)
                lines.append(line(f"{name}{', with the U-turn' if whole else ''}: {detector}", told))
                found += rows_of(f"{name}{'_whole' if whole else ''}{suffix}", told)
            if detector == DEFAULT.detector and all(walk.landed is not None for walk in walks):
                sd = 1000.0 * reference_sd(walks, founds)
                found.append(Row(f"ic_reference_sd_ms_{name}", sd, "ms", n=len(walks), split="three-cornered hat"))
    show("Initial contacts at the lower back", COLUMNS, lines)
    return found
