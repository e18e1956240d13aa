"""Strides of the trunk that replace strides of the legs, compared with the rest of the walk."""

import numpy as np

from jgait.estimators.combined.compare import regular
from jgait.estimators.combined.strides import LEG_WORN, JoinedStrides
from jgait.estimators.stride_flags import AROUND, DOUBTFUL, FEWEST_STRIDES, HALF, TURNING, UNEVEN_DURATION, durations
from jgait.notes import Kind, Note
from jgait.types import as_float

REPLACED_UNLIKE = Kind(
    "replaced_strides_unlike", "check",
    "{replaced} of {of} strides are by the waist's sensor in place of those on the legs; {strides} of them "
    "{strides:is|are} in doubt, because strides by the waist last {times:.2f} times as long as those around them",
    "Sensors on the legs are in doubt there, or have no strides, and those of the waist do not go on as the walk "
    "before and after: samples are lost or repeated without a gap in the time, or the person did not walk. Times, and "
    "lengths, which follow from them, are wrong there; these strides are not in the means.",
)  # fmt: skip

UNLIKE = 1.0 / 0.85
"""[1] Ratio between the durations of a stride by the trunk and the strides by the legs around it, above which they
contradict each other; chosen, above that in walks of `ipol_gait` where no samples are lost."""

MANY = 0.1
"""[1] Share of the strides by the trunk that follow each other, beyond which all of these are in doubt: the durations
of steady strides differ so much in far fewer."""


def with_replaced_doubted(joined: JoinedStrides) -> tuple[JoinedStrides, list[Note]]:
    """The strides, with doubt on strides by the trunk that last longer or shorter than those by the legs around, and a
    note.

    Strides in a turn, and from or to standing, are not compared. Strides follow each other until the next of the legs
    that is not in doubt, so that those of one leg whose sensor is loose each stand alone.
    """
    doubted = joined.flags[DOUBTFUL.name]
    replaced = np.array([name not in LEG_WORN for name in joined.first], bool)
    start, lasts = as_float(joined.strides.start), durations(joined.strides)
    of_legs = np.flatnonzero(~replaced & regular(joined) & np.isfinite(lasts))
    special = [joined.flags[flag.name] for flag in (TURNING, HALF) if flag.name in joined.flags]
    compared = replaced & np.isfinite(lasts) & ~np.logical_or.reduce([doubted, *special])
    if len(of_legs) < FEWEST_STRIDES or not compared.any():
        return joined, []
    near = np.argsort(np.abs(start[:, None] - start[of_legs]), axis=1, kind="stable")[:, : 2 * AROUND]
    times = lasts / np.median(lasts[of_legs][near], axis=1)
    unlike = compared & (np.abs(np.log(times, where=compared, out=np.zeros_like(times))) > np.log(UNLIKE))
    breaks = np.cumsum(~replaced & ~doubted)
    more = np.zeros_like(unlike)
    for number in np.unique(breaks[unlike]):
        stretch = compared & (breaks == number)
        more |= stretch & (unlike if unlike[stretch].mean() <= MANY else True)
    if not more.any():
        return joined, []
    counts = {"replaced": replaced.sum(), "of": len(more), "strides": more.sum()}
    note = REPLACED_UNLIKE(**counts, times=np.median(times[unlike]))
    uneven = joined.flags.get(UNEVEN_DURATION.name, np.zeros_like(more)) | more  # their times are wrong, too
    return joined._replace(flags={**joined.flags, DOUBTFUL.name: doubted | more, UNEVEN_DURATION.name: uneven}), [note]
