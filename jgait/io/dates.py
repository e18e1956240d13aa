"""Dates, times of day and durations in the time column of a table, as texts or as pandas' types, in seconds."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

HALF_DAY_S, HOUR_S = 43200.0, 3600.0
"""[s], [s] After so long, times of day begin again at the latest where the day's half is not stated, and minutes with
seconds do."""

SPELT = (
    r"^(?P<date>.*?)[\sT,;]*(?P<hour>\d+:)?(?P<minute>\d{1,2}):(?P<second>\d{2}(?:[.,]\d+)?)"
    r"\s*(?:(?P<half>[AaPp])\.?\s*[Mm]\b)?"
)
"""Pattern of a time: perhaps a date, perhaps hours, minutes, seconds, perhaps AM or PM."""


class Dated(NamedTuple):
    """Times of a column."""

    seconds: np.ndarray  #: (T,) [s] from the first date on, or as times of day or durations have them; NaN where empty.
    begin_s: float | None  #: [s] from 1970 to the first date; None for times of day and durations.


def date_of(since_1970: float) -> str:
    """The date at a time [s] since 1970."""
    return str(np.datetime64(round(1e3 * since_1970), "ms")).replace("T", " ")


def dated(column: "pd.Series") -> Dated | None:
    """Dates, times of day or durations, or texts of these, in s; None for a column of anything else.

    Times of day pass midnight. Where day and month could change places, the dates that are closer together are taken.
    """
    import pandas as pd

    turn = None
    if ":" in str(next(iter(column.dropna()), "")) and not pd.api.types.is_timedelta64_dtype(column.dtype):
        texts = column.astype("string")
        column = pd.to_datetime(texts, format="ISO8601", errors="coerce", utc=True)
        if column.isna().all() and texts.str.contains("day").any():
            column = pd.to_timedelta(texts, errors="coerce")
        elif column.isna().all():
            column, turn = _spelt(texts)
        if column.isna().all():
            return None
    begin_s = None
    if pd.api.types.is_datetime64_any_dtype(column.dtype):
        begin_s = float(column.min().timestamp())
        column = column - column.min()
    if not pd.api.types.is_timedelta64_dtype(column.dtype):
        return None
    seconds = column.dt.total_seconds().to_numpy(np.float64)
    return Dated(seconds if turn is None else _going_on(seconds, turn), begin_s)


def _spelt(texts: "pd.Series") -> "tuple[pd.Series, float | None]":
    """Dates or times of day, spelt otherwise than by ISO 8601, and when they begin again [s]; NaT for other texts."""
    import pandas as pd

    parts = texts.str.extract(SPELT)
    hours, date = parts["hour"].str.rstrip(":"), parts["date"].str.strip()
    at_date = bool((date.fillna("") != "").any())
    clock = hours.fillna("0") + ":" + parts["minute"] + ":" + parts["second"].str.replace(",", ".")
    if at_date and hours.isna().all():
        clock = parts["minute"] + ":" + parts["second"] + ":00"
    time = pd.to_timedelta(clock, errors="coerce")
    if parts["half"].notna().any():
        noon = hours == "12"
        late = parts["half"].str.lower() == "p"
        time += pd.to_timedelta(np.where(late & ~noon, 12, np.where(noon & ~late, -12, 0)), unit="h")
    if not at_date:
        return time, HOUR_S if hours.isna().all() else HALF_DAY_S
    each = date.dropna().unique()
    readings = []
    dots = any("." in one for one in each)  # dates with dots begin with the day
    for day_first in (dots, not dots):
        days = pd.Series(
            [pd.to_datetime(one, dayfirst=day_first, errors="coerce", format="mixed") for one in each], each
        )
        whole = date.map(days) + time
        readings.append((int(whole.isna().sum()), whole.max() - whole.min(), whole))
    readings.sort(key=lambda reading: reading[:2])
    return readings[0][2], None


def _going_on(seconds: np.ndarray, turn: float) -> np.ndarray:
    """Times without the steps back by which a clock begins again after some turns."""
    steps = np.diff(seconds, prepend=seconds[:1])
    turns = np.where(steps < -0.5 * turn, np.rint(-steps / turn), 0.0)
    return seconds + turn * np.cumsum(turns)
