"""Statistics of a cohort's errors: intervals over subjects, agreement with a reference, change of errors.

Strides of one person are not independent: confidence intervals are computed by resampling subjects, or from the
variance over subjects. On the host, in NumPy, SciPy and pandas.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from jgait.evaluate.reliability import LEVEL, finite_pair, icc21, icc_of_squares, limits_of_agreement
from jgait.types import as_float, numbered_people

if TYPE_CHECKING:
    import pandas as pd


AGREEMENT = (
    "n", "n_subjects", "bias", "bias_low", "bias_high", "loa_low", "loa_high", "rmse", "mae", "mae_low", "mae_high",
    "max_abs", "icc", "icc_low", "icc_high", "n_dropped",
)  # fmt: skip
"""Columns of the table of `agreement`."""


ROUNDING = 1e-6
"""[1] Share of a reference's size below which its values are all the same."""

RESAMPLES = 2000
"""Number of resamples of an interval over subjects."""


class PairedDifference(NamedTuple):
    """Change of errors, after − before; a negative change is an improvement.

    Attributes:
        estimate: median over subjects of their mean change, in the unit of the errors, with its interval.
        n: number of subjects; `better` and `worse`: those whose errors decreased or increased.
    """

    estimate: float
    low: float
    high: float
    n: int
    better: int
    worse: int

    @property
    def worse_beyond_noise(self) -> bool:
        """Whether the whole interval is above 0: errors increased."""
        return self.low > 0.0


def _draws(count: int, seed: int, resamples: int) -> np.ndarray:
    """Indices (resamples, count) of the subjects in each bootstrap resample."""
    if resamples < 1:
        raise ValueError(f"resamples must be positive; got {resamples!r}")
    return np.random.default_rng(seed).integers(0, count, (resamples, count))


def _ends(values: npt.ArrayLike) -> tuple[float, float]:
    """Lower and upper quantile that enclose the central share `LEVEL` of the finite values."""
    values = as_float(values)
    values = values[np.isfinite(values)]
    if not values.size:
        return np.nan, np.nan
    low, high = np.quantile(values, [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0])
    return float(low), float(high)


def paired_difference(
    before: npt.ArrayLike,
    after: npt.ArrayLike,
    subjects: npt.ArrayLike,
    *,
    seed: int,
) -> PairedDifference:
    """Median paired change of errors, with its 95 % interval over subjects; every subject has the same weight.

    `before` and `after` (n,) are sizes of errors of the same recordings, `subjects` (n,) the subject of each, whose
    changes are averaged; the interval is the percentile bootstrap of 2000 resamples, drawn with the seed.

    Raises:
        ValueError: if the three differ in length, a value is not finite, or there are fewer than two subjects.
    """
    first, second = finite_pair(before, after, "before", "after")
    if np.shape(subjects) != first.shape:
        raise ValueError(f"subjects must name one of each of the {first.size} rows; got shape {np.shape(subjects)}")
    names, codes = numbered_people(np.asarray(subjects, object))
    count = len(names)
    if count < 2:
        raise ValueError(f"a paired difference needs at least two subjects; got {count}")
    changes = np.bincount(codes, second - first) / np.bincount(codes)
    low, high = _ends(np.median(changes[_draws(count, seed, RESAMPLES)], axis=1))
    better, worse = int(np.sum(changes < 0.0)), int(np.sum(changes > 0.0))
    return PairedDifference(float(np.median(changes)), low, high, count, better, worse)


def require_columns(table: "pd.DataFrame", names: Sequence[str]) -> None:
    """Refuse a table that lacks one of the columns."""
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise ValueError(f"the table needs the columns {list(names)}; it has {list(table.columns)}: {missing} missing")


def with_errors(table: "pd.DataFrame") -> "pd.DataFrame":
    """The table with columns `error` (estimate − reference), `abs_error` and `rel_error` (over the reference, or NaN).

    Raises:
        ValueError: if column `estimate` or `reference` is missing.
    """
    require_columns(table, ("estimate", "reference"))
    estimate, reference = (table[name].to_numpy(dtype=float) for name in ("estimate", "reference"))
    error = estimate - reference
    relative = np.divide(error, reference, out=np.full_like(error, np.nan), where=reference != 0.0)
    return table.assign(error=error, abs_error=np.abs(error), rel_error=relative)


def agreement(table: "pd.DataFrame", *, seed: int = 0, resamples: int = RESAMPLES) -> "pd.DataFrame":
    """Agreement of estimates with their reference, one row a quantity, in order of appearance.

    Bias and limits are those of `limits_of_agreement` with the rows' subjects; the interval of the mean absolute error
    is bootstrapped over subjects. The interval of ICC(2,1) is bootstrapped if a subject has several rows, because the
    F-based interval assumes independent rows. Values that cannot be computed (one subject, one row; the ICC of a
    reference that does not vary) are NaN.

    Args:
        table: long, with columns `quantity`, `estimate`, `reference` and `subject`.
        seed: seed of the resampling of subjects.
        resamples: number of resamples.

    Returns:
        Index `quantity`; columns `AGREEMENT`, in the quantity's unit. Rows that are not finite are left out and counted
        in `n_dropped`.

    Raises:
        ValueError: if a column is missing.
    """
    import pandas as pd

    require_columns(table, ("subject", "quantity", "estimate", "reference"))
    rows = {}
    for name in table["quantity"].unique():
        chosen = table[table["quantity"] == name]
        pairs = chosen[["estimate", "reference"]].to_numpy(dtype=float)
        finite = np.isfinite(pairs).all(axis=1)
        row = _agreement(pairs[finite], numbered_people(chosen["subject"][finite])[1], seed=seed, resamples=resamples)
        rows[name] = row | {"n_dropped": int(np.sum(~finite))}
    whole = {"n": int, "n_subjects": int, "n_dropped": int}
    made = pd.DataFrame.from_dict(rows, orient="index").reindex(columns=list(AGREEMENT))  # also with no rows
    return made.rename_axis("quantity").astype(whole)


def _agreement(pairs: np.ndarray, codes: np.ndarray, *, seed: int, resamples: int) -> dict[str, float]:
    """One row of the table of agreement, from finite pairs (estimate, reference) (n, 2)."""
    nan = float("nan")
    n, error, count = len(pairs), pairs[:, 0] - pairs[:, 1], len(np.unique(codes))
    row = dict.fromkeys(AGREEMENT, nan) | {"n": n, "n_subjects": count}
    if n == 0:
        return row
    size = np.abs(error)
    row |= {"bias": error.mean(), "rmse": np.sqrt(np.mean(error**2)), "mae": size.mean(), "max_abs": size.max()}
    varies = np.ptp(pairs[:, 1]) > ROUNDING * np.abs(pairs[:, 1]).max()
    if n > 1 and varies:
        row |= {"icc": icc21(pairs).value}
    if count < 2:
        return row
    limits = limits_of_agreement(*pairs.T, subjects=codes)
    row |= {
        "bias_low": limits.bias_low,
        "bias_high": limits.bias_high,
        "loa_low": limits.lower,
        "loa_high": limits.upper,
    }
    sums = _moments(pairs, codes)
    drawn = np.array([sums[draw].sum(axis=0) for draw in _draws(count, seed, resamples)])
    row["mae_low"], row["mae_high"] = _ends(drawn[:, 1] / drawn[:, 0])
    if varies:
        row["icc_low"], row["icc_high"] = _ends(_icc_of_moments(drawn)) if n > count else icc21(pairs)[1:3]
    return row


def _moments(pairs: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """(subjects, 7) n, Σ|x − y|, Σx, Σy, Σx², Σy², Σ(x + y)²; their sums over a resample give its statistics."""
    x, y = (pairs - pairs.mean()).T
    columns = (np.ones_like(x), np.abs(x - y), x, y, x**2, y**2, (x + y) ** 2)
    return np.stack([np.bincount(codes, column) for column in columns], axis=1)


def _icc_of_moments(sums: np.ndarray) -> np.ndarray:
    """ICC(2,1) of two raters from the sums of `_moments` (..., 7)."""
    n, _, x, y, xx, yy, both = sums.T
    grand = (x + y) ** 2 / (2.0 * n)
    between, raters = both / 2.0 - grand, (x**2 + y**2) / n - grand
    rest = np.maximum(xx + yy - grand - between - raters, 0.0)
    return icc_of_squares(between / (n - 1.0), raters, rest / (n - 1.0), n, 2)
