"""Agreement of estimates with their reference, and changes of errors, with intervals over people.

Strides of one person are not independent: confidence intervals are computed by resampling subjects, or from the
variance over subjects. On the host, in NumPy, SciPy and pandas.

Source:
    Shrout and Fleiss, Intraclass correlations: uses in assessing rater reliability, Psychological Bulletin 86 (1979).
    McGraw and Wong, Forming inferences about some intraclass correlation coefficients, Psychological Methods 1 (1996).
    Bland and Altman, Statistical methods for assessing agreement between two methods of clinical measurement, Lancet
    327 (1986); Agreement between methods of measurement with multiple observations per individual, Journal of
    Biopharmaceutical Statistics 17 (2007).
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from jgait.types import Values, as_float, numbered_people

if TYPE_CHECKING:
    import pandas as pd

LEVEL = 0.95
"""[1] Coverage probability of every interval, and share of differences between the limits of agreement."""


class Icc(NamedTuple):
    """Intraclass correlation of n targets [1], with its confidence interval; NaN where all targets are equal."""

    value: float
    low: float
    high: float
    n: int


class Limits(NamedTuple):
    """Bias and limits of agreement, each with the ends of its confidence interval, in the unit of the measurement."""

    bias: float  #: mean of estimate − reference.
    bias_low: float
    bias_high: float
    sd: float  #: of a single difference, of any measurement of any subject.
    lower: float
    lower_low: float
    lower_high: float
    upper: float
    upper_low: float
    upper_high: float
    n: int  #: number of differences.
    n_subjects: int


def icc21(ratings: npt.ArrayLike) -> Icc:
    """Intraclass correlation ICC(2,1): two-way random effects, absolute agreement, single measurement.

    ICC = (MSR − MSE) / (MSR + (k − 1) MSE + k (MSC − MSE) / n), with the mean squares of rows, columns and residual.
    `ratings` (n, k) have a row a target and a column a rater. The interval is that of `LEVEL`, for independent targets.

    Raises ValueError if there are not at least two targets and two raters, or a rating is not finite.

    Source: Shrout and Fleiss 1979, table 4 and its interval; McGraw and Wong 1996, table 7, case 2, ICC(A,1).
    """
    table = as_float(ratings)
    if table.ndim != 2 or min(table.shape) < 2 or not np.isfinite(table).all():
        raise ValueError(f"ratings must be finite and (n, k) with n, k >= 2; got shape {table.shape}")
    n, k = table.shape
    table = table - table.mean()
    rows, columns = table.mean(axis=1), table.mean(axis=0)
    between = k * np.sum(rows**2) / (n - 1)
    raters = n * np.sum(columns**2) / (k - 1)
    rest = np.sum((table - rows[:, None] - columns) ** 2) / ((n - 1) * (k - 1))
    value = float(_icc_of_squares(between, raters, rest, n, k))
    if not value < 1.0:  # all ratings agree exactly, or all are equal: without noise no interval can be computed
        return Icc(value, value, value, n)
    from scipy import stats

    a = k * value / (n * (1.0 - value))
    parts = np.array([a * raters, (1.0 + a * (n - 1)) * rest])
    top = 0.5 + LEVEL / 2.0
    with np.errstate(all="ignore"):  # Satterthwaite's degrees of freedom can be 0 if ICC < 0
        freedom = parts.sum() ** 2 / np.sum(parts**2 / np.array([k - 1.0, (n - 1.0) * (k - 1.0)]))
        down, up = stats.f.ppf(top, n - 1, freedom), stats.f.ppf(top, freedom, n - 1)
        noise = k * raters + (k * n - k - n) * rest
        low = n * (between - down * rest) / (down * noise + n * between)
        high = n * (up * between - rest) / (noise + n * up * between)
    known = np.isfinite([low, high]).all()
    return Icc(value, float(low) if known else np.nan, float(high) if known else np.nan, n)


def _icc_of_squares(between: Values, raters: Values, rest: Values, n: Values, k: int) -> np.ndarray:
    """ICC(2,1) from the mean squares of targets, raters and residual; NaN where all are 0."""
    total = as_float(between + (k - 1) * rest + k * (raters - rest) / n)
    return np.divide(between - rest, total, out=np.full_like(total, np.nan), where=total > 0.0)


def limits_of_agreement(
    estimate: npt.ArrayLike, reference: npt.ArrayLike, *, subjects: npt.ArrayLike | None = None
) -> Limits:
    """Bland and Altman's limits, which contain the share `LEVEL` of the differences estimate − reference, each (N,).

    limits = bias ± z √(σ_B² + σ_W²). An unbalanced one-way analysis of variance gives σ_W² within subjects and σ_B² =
    (MSB − MSW) (n − 1) Σm / ((Σm)² − Σm²) between subjects, m the rows of each of n subjects, and not below 0. The
    intervals add the variances of the bias and of z times the standard deviation, with t of n − 1; with 15 subjects of
    1 to 11 rows, the intervals of the bias cover in 95 % of cases and those of the limits in 90 %. `subjects` (N,) is
    the subject of each row; None where each row is of another subject.

    Raises ValueError if lengths differ, a value is not finite, or there are fewer than two subjects.

    Source: Bland and Altman 1986, and 2007 section 3 (the true value varies) for repeated measurements.
    """
    from scipy import stats

    ours, theirs = _finite_pair(estimate, reference, "estimate", "reference")
    difference = ours - theirs
    if subjects is not None and np.shape(subjects) != difference.shape:
        raise ValueError(f"subjects must name one of each of {difference.size} rows; got shape {np.shape(subjects)}")
    codes = np.arange(ours.size) if subjects is None else numbered_people(np.asarray(subjects, object))[1]
    count = int(codes.max()) + 1
    if count < 2:
        raise ValueError(f"limits of agreement need at least two subjects; got {count}")
    bias = float(difference.mean())
    variance, of_bias, of_sd = _variances(difference, np.bincount(codes), codes)
    sd, top = float(np.sqrt(variance)), 0.5 + LEVEL / 2.0
    z, t = float(stats.norm.ppf(top)), float(stats.t.ppf(top, count - 1))
    half, wide = float(t * np.sqrt(of_bias)), float(t * np.sqrt(of_bias + z**2 * of_sd))
    lower, upper = bias - z * sd, bias + z * sd
    return Limits(
        *(bias, bias - half, bias + half), sd,
        *(lower, lower - wide, lower + wide), *(upper, upper - wide, upper + wide), ours.size, count,
    )  # fmt: skip


def _variances(difference: np.ndarray, sizes: np.ndarray, codes: np.ndarray) -> tuple[float, float, float]:
    """Variances of one difference, of the mean difference, and of the estimated standard deviation."""
    n, total = sizes.size, difference.size
    means = np.bincount(codes, difference) / sizes
    between = float(np.sum(sizes * (means - difference.mean()) ** 2) / (n - 1))
    if total == n:
        return between, between / n, between / (2.0 * (n - 1))
    within = float(np.sum((difference - means[codes]) ** 2) / (total - n))
    share = (n - 1) * total / float(total**2 - np.sum(sizes**2))
    persons = max(share * (between - within), 0.0)
    variance = persons + within
    of_bias = persons * float(np.sum(sizes**2)) / total**2 + within / total
    if persons == 0.0:
        return variance, of_bias, variance / (2.0 * (total - n))
    spread = 2.0 * ((share * between) ** 2 / (n - 1) + ((1.0 - share) * within) ** 2 / (total - n))
    return variance, of_bias, spread / (4.0 * variance)


def _finite_pair(column: npt.ArrayLike, other: npt.ArrayLike, *names: str) -> tuple[np.ndarray, np.ndarray]:
    """Two equally long columns of finite numbers, at least two of them."""
    first, second = as_float(column), as_float(other)
    if first.ndim != 1 or first.shape != second.shape or first.size < 2:
        raise ValueError(
            f"{names[0]} and {names[1]} must be (n,) with the same n >= 2; got {first.shape} and {second.shape}"
        )
    for name, values in zip(names, (first, second), strict=True):
        if not np.isfinite(values).all():
            raise ValueError(f"{name} must be finite; {int(np.sum(~np.isfinite(values)))} of {values.size} are not")
    return first, second


AGREEMENT = (
    "n", "n_subjects", "bias", "bias_low", "bias_high", "loa_low", "loa_high", "rmse", "mae", "mae_low", "mae_high",
    "max_abs", "icc", "icc_low", "icc_high", "n_dropped",
)  # fmt: skip
"""Columns of the table of `agreement`."""


class PairedDifference(NamedTuple):
    """Change of errors, after − before; a negative change is an improvement."""

    estimate: float  #: median over subjects of their mean change, in the unit of the errors.
    low: float
    high: float
    n: int  #: number of subjects.
    better: int  #: number of those whose errors decreased.
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
    known = as_float(values)[np.isfinite(values)]
    low, high = np.quantile(known, [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0]) if known.size else (np.nan, np.nan)
    return float(low), float(high)


def paired_difference(
    before: npt.ArrayLike, after: npt.ArrayLike, subjects: npt.ArrayLike, *, seed: int
) -> PairedDifference:
    """Median paired change of errors, with its 95 % interval over subjects; every subject has the same weight.

    `before` and `after` (n,) are sizes of errors of the same recordings, `subjects` (n,) the subject of each, whose
    changes are averaged; the interval is the percentile bootstrap of 2000 resamples, drawn with the seed.

    Raises:
        ValueError: if the three differ in length, a value is not finite, or there are fewer than two subjects.
    """
    first, second = _finite_pair(before, after, "before", "after")
    if np.shape(subjects) != first.shape:
        raise ValueError(f"subjects must name one of each of the {first.size} rows; got shape {np.shape(subjects)}")
    names, codes = numbered_people(np.asarray(subjects, object))
    count = len(names)
    if count < 2:
        raise ValueError(f"a paired difference needs at least two subjects; got {count}")
    changes = np.bincount(codes, second - first) / np.bincount(codes)
    low, high = _ends(np.median(changes[_draws(count, seed, 2000)], axis=1))
    better, worse = int(np.sum(changes < 0.0)), int(np.sum(changes > 0.0))
    return PairedDifference(float(np.median(changes)), low, high, count, better, worse)


def require_columns(table: "pd.DataFrame", names: Sequence[str]) -> None:
    """Refuse a table that lacks one of the columns."""
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise ValueError(f"the table needs the columns {list(names)}; it has {list(table.columns)}: {missing} missing")


def with_errors(table: "pd.DataFrame") -> "pd.DataFrame":
    """The table with columns `error` (estimate − reference), `abs_error` and `rel_error` (over the reference, or NaN).
    Raises ValueError if column `estimate` or `reference` is missing.
    """
    require_columns(table, ("estimate", "reference"))
    estimate, reference = (table[name].to_numpy(dtype=float) for name in ("estimate", "reference"))
    error = estimate - reference
    relative = np.divide(error, reference, out=np.full_like(error, np.nan), where=reference != 0.0)
    return table.assign(error=error, abs_error=np.abs(error), rel_error=relative)


def agreement(table: "pd.DataFrame", *, seed: int = 0, resamples: int = 2000) -> "pd.DataFrame":
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
    n, error, count = len(pairs), pairs[:, 0] - pairs[:, 1], len(np.unique(codes))
    row = dict.fromkeys(AGREEMENT, float("nan")) | {"n": n, "n_subjects": count}
    if n == 0:
        return row
    size = np.abs(error)
    row |= {"bias": error.mean(), "rmse": np.sqrt(np.mean(error**2)), "mae": size.mean(), "max_abs": size.max()}
    varies = n > 1 and np.ptp(pairs[:, 1]) > 1e-6 * np.abs(pairs[:, 1]).max()  # else rounding errors
    icc = icc21(pairs) if varies else Icc(np.nan, np.nan, np.nan, n)
    row["icc"] = icc.value
    if count < 2:
        return row
    limits = limits_of_agreement(*pairs.T, subjects=codes)
    row |= {"bias_low": limits.bias_low, "bias_high": limits.bias_high}
    row |= {"loa_low": limits.lower, "loa_high": limits.upper}
    # sums of each subject: n, Σ|x − y|, Σx, Σy, Σx², Σy², Σ(x + y)²; their sums over a resample give its statistics
    x, y = (pairs - pairs.mean()).T
    columns = (np.ones_like(x), size, x, y, x**2, y**2, (x + y) ** 2)
    sums = np.stack([np.bincount(codes, column) for column in columns], axis=1)
    drawn = np.array([sums[draw].sum(axis=0) for draw in _draws(count, seed, resamples)])
    row["mae_low"], row["mae_high"] = _ends(drawn[:, 1] / drawn[:, 0])
    row["icc_low"], row["icc_high"] = _ends(_icc_of_sums(drawn)) if n > count and varies else icc[1:3]
    return row


def _icc_of_sums(sums: np.ndarray) -> np.ndarray:
    """ICC(2,1) of two raters from the sums (..., 7) of `_agreement`."""
    n, _, x, y, xx, yy, both = sums.T
    grand = (x + y) ** 2 / (2.0 * n)
    between, raters = both / 2.0 - grand, (x**2 + y**2) / n - grand
    rest = np.maximum(xx + yy - grand - between - raters, 0.0)
    return _icc_of_squares(between / (n - 1.0), raters, rest / (n - 1.0), n, 2)
