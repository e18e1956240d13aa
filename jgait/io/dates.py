"""The clock in a table: numbers, or dates, times of day and durations, as texts or as pandas' types, in seconds."""

import re
from typing import TYPE_CHECKING

import numpy as np

from jgait.io.clock import TIME_UNITS, check_order, count_samples, unit_of_time
from jgait.io.names import column_of, unit_in_name

if TYPE_CHECKING:
    import pandas as pd

SPELT = r"^(?P<date>.*?)[\sT;]*(?P<clock>\d{1,2}:\d{2}:\d{2}(?:\.\d+)?)\s*(?P<half>[AaPp])?\.?[Mm]?\.?$"
"""Pattern of a time that is not spelt by ISO 8601: perhaps a date, a time of day, perhaps AM or PM."""


def date_of(since_1970: float) -> str:
    """The date at a time [s] since 1970."""
    return str(np.datetime64(round(1e3 * since_1970), "ms")).replace("T", " ")


def dated(column: "pd.Series") -> tuple[np.ndarray, float | None] | None:
    """Times (T,) [s] of dates, times of day or durations, or of texts of these, NaN where empty, and the first date [s
    since 1970], None without. Times of day pass midnight; day and month are those whose dates are closer together. None
    for a column of anything else.
    """
    import pandas as pd

    if not pd.api.types.is_timedelta64_dtype(column.dtype) and ":" in str(next(iter(column.dropna()), "")):
        texts = column.astype("string").str.strip().str.replace(",", ".")
        column = pd.to_datetime(texts, format="ISO8601", errors="coerce", utc=True)
        if column.isna().all():
            column = pd.to_timedelta(texts, errors="coerce")
        if column.isna().all():
            column = _spelt(texts)
        if column.isna().all():
            return None
    if pd.api.types.is_datetime64_any_dtype(column.dtype):
        return (column - column.min()).dt.total_seconds().to_numpy(np.float64), float(column.min().timestamp())
    if not pd.api.types.is_timedelta64_dtype(column.dtype):
        return None
    seconds = column.dt.total_seconds().to_numpy(np.float64)
    midnights = np.diff(seconds, prepend=seconds[:1]) < -43_200.0
    return seconds + 86_400.0 * np.cumsum(midnights), None


def _spelt(texts: "pd.Series") -> "pd.Series":
    """Dates, or times of day, of texts that are not spelt by ISO 8601; missing for other texts."""
    import pandas as pd

    parts = texts.str.extract(SPELT)
    time = pd.to_timedelta(parts["clock"], errors="coerce")
    if parts["half"].notna().any():
        half_day = pd.Timedelta(hours=12)
        time = time % half_day + parts["half"].str.lower().eq("p").fillna(False).astype(int) * half_day
    if parts["date"].fillna("").eq("").all():
        return time
    days = pd.Index(parts["date"].dropna().unique())
    readings = []
    for day_first in (True, False) if days.str.contains(".", regex=False).any() else (False, True):
        dates = pd.to_datetime(days, dayfirst=day_first, errors="coerce", format="mixed")
        readings.append(parts["date"].map(pd.Series(dates, days)) + time)
    return min(readings, key=lambda dates: (dates.isna().sum(), dates.max() - dates.min()))


def with_time(table: "pd.DataFrame") -> "pd.DataFrame":
    """The table with its index as the column `time`, if the index is a clock and no column is."""
    import pandas as pd

    index = table.index
    named = column_of(str(index.name)) == "time"
    if any(column_of(str(column)) == "time" for column in table.columns):
        return table
    if not named and not isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex):
        return table
    return table.reset_index(names=str(index.name) if named else "time")


def clock_of(table: "pd.DataFrame", name: str) -> tuple[np.ndarray | None, float | None]:
    """Times (T,) [s] by the index of a table or its first clock, and the seconds from 1970 to their 0, if any; None
    without.
    """
    table = with_time(table)
    clocks = [
        column for column in map(str, table.columns)
        if column_of(column) == "time" or re.search("epoc|time|elapsed", column, re.IGNORECASE)
    ]  # fmt: skip
    for column in sorted(clocks, key=lambda column: table[column].dtype.kind not in "iuf"):
        if (dates := dated(table[column])) is not None:
            return dates
        stamps = table[column].to_numpy()
        if stamps.dtype.kind not in "iuf" or len(stamps) < 2 or count_samples(stamps):
            continue
        check_order(stamps.astype(np.float64), name)
        scale = TIME_UNITS[unit_of_time(stamps.astype(np.float64), unit_in_name(column), name)]
        begin_s = scale * float(stamps[0])
        if 1e9 < begin_s < 4e9:  # since 1970: 2001 to 2096
            return scale * (stamps - stamps[0]), begin_s
        return scale * stamps, None
    return None, None
