"""Statistics of a cohort: worked examples of the papers, intervals that cover, and refusals that say what is wrong."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from jgait import evaluate


def cohort(sizes, *, seed=0, bias=0.01, between=0.03, within=0.02, quantity="stride_length"):
    """Rows of each subject: a reference that varies, an error with a part of the person and a part of the stride."""
    rng = np.random.default_rng(seed)
    count, codes = len(sizes), np.repeat(np.arange(len(sizes)), sizes)
    reference = 1.2 + rng.normal(0.0, 0.1, count)[codes] + rng.normal(0.0, 0.05, codes.size)
    error = bias + rng.normal(0.0, between, count)[codes] + rng.normal(0.0, within, codes.size)
    table = {"subject": [f"s{c}" for c in codes], "quantity": quantity, "estimate": reference + error}
    return evaluate.with_errors(pd.DataFrame({**table, "reference": reference}))


def icc(estimate, reference):
    return evaluate.icc21(np.stack([estimate, reference], axis=1))


def over_subjects(table, statistic, *, seed, resamples):
    """Interval of a statistic of a table of which whole subjects are drawn."""
    rng, people = np.random.default_rng(seed), [rows for _, rows in table.groupby("subject", sort=False)]
    draws = [rng.integers(0, len(people), len(people)) for _ in range(resamples)]
    return tuple(np.quantile([statistic(pd.concat([people[k] for k in draw])) for draw in draws], [0.025, 0.975]))


# --- over subjects ---


def test_paired_difference_by_hand():
    before, after = np.array([3.0, 5.0, 2.0, 4.0, 4.0]), np.array([2.0, 4.0, 2.5, 4.0, 2.0])
    change = evaluate.paired_difference(before, after, ["a", "a", "b", "c", "d"], seed=0)
    assert change.estimate == -0.5  # changes of a, b, c, d: −1, 0.5, 0, −2
    assert (change.n, change.better, change.worse) == (4, 2, 1)
    assert change.low == -2.0 and change.high == 0.5
    assert not change.worse_beyond_noise


def test_pairs_see_a_change_that_is_small_beside_the_spread_of_people():
    rng = np.random.default_rng(0)
    before, names = rng.gamma(4.0, 1.0, 200), np.arange(200)
    change = rng.normal(0.1, 0.1, 200)
    worse = evaluate.paired_difference(before, before + change, names, seed=1)
    assert worse.worse_beyond_noise and worse.worse > 150
    # the median of normals is known to ± 1.96 · 1.2533 s/√n, within what one draw of them can tell
    assert worse.high - worse.low == pytest.approx(2.0 * 1.96 * 1.2533 * change.std() / np.sqrt(200), rel=0.35)
    again = [evaluate.paired_difference(before, before + change, names, seed=seed) for seed in (1, 2)]
    assert again[0] == worse != again[1]


# --- intraclass correlation ---


SHROUT_FLEISS = np.array([[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]])


def test_icc_of_the_example_of_shrout_and_fleiss():
    icc = evaluate.icc21(SHROUT_FLEISS)
    # table 3: BMS 11.24, JMS 32.49, EMS 1.02
    assert icc.value == pytest.approx(
        (11.2417 - 1.0194) / (11.2417 + 3 * 1.0194 + 4 * (32.4861 - 1.0194) / 6), abs=1e-4
    )
    assert round(icc.value, 2) == 0.29
    assert (round(icc.low, 2), round(icc.high, 2)) == (0.02, 0.76)
    assert icc.n == 6


def test_icc_of_two_raters_by_the_components_of_variance():
    rng = np.random.default_rng(0)
    truth = rng.normal(0.0, 3.0, 4000)
    one, two = truth + rng.normal(0.0, 1.0, 4000), truth + rng.normal(0.0, 1.0, 4000)
    assert icc(one, two).value == pytest.approx(0.9, abs=0.01)
    # an offset d between two raters has variance d²/2 and counts against absolute agreement
    assert icc(one + 2.0, two).value == pytest.approx(9.0 / (9.0 + 1.0 + 2.0), abs=0.01)
    pair = np.stack([one[:50], two[:50]], axis=1)
    np.testing.assert_allclose(evaluate.icc21(1e6 + 10.0 * pair)[:3], evaluate.icc21(pair)[:3], rtol=1e-6)


def test_icc_where_nothing_or_everything_agrees():
    assert icc([1.0, 2.0, 4.0], [1.0, 2.0, 4.0]) == (1.0, 1.0, 1.0, 3)
    assert np.isnan(icc([1.0, 1.0], [1.0, 1.0])[:3]).all()
    assert icc([1.0, 2.0, 3.0], [3.0, 2.0, 1.0]).value < 0.0


# --- limits of agreement ---


def test_limits_of_the_example_of_bland_and_altman():
    # peak expiratory flow by two meters [l/min], Lancet 1986
    large = [494, 395, 516, 434, 476, 557, 413, 442, 650, 433, 417, 656, 267, 478, 178, 423, 427]
    mini = [512, 430, 520, 428, 500, 600, 364, 380, 658, 445, 432, 626, 260, 477, 259, 350, 451]
    limits = evaluate.limits_of_agreement(large, mini)
    assert round(limits.bias, 1) == -2.1
    assert round(limits.sd, 1) == 38.8
    assert (round(limits.bias_low, 1), round(limits.bias_high, 1)) == (-22.0, 17.8)
    # they take 2 s and 3 s²/n for 1.96 s and (1 + 1.96²/2 · 17/16) s²/n
    np.testing.assert_allclose([limits.lower, limits.upper], [-79.7, 75.5], atol=0.05 * 38.8)
    np.testing.assert_allclose([limits.lower_low, limits.upper_high], [-114.3, 110.1], atol=0.05 * 38.8)
    assert (limits.n, limits.n_subjects) == (17, 17)


def test_repeated_measures_by_hand():
    difference = np.array([1.0, 3.0, 6.0, 2.0, 4.0, 9.0])
    names = ["a", "a", "b", "c", "c", "c"]
    limits = evaluate.limits_of_agreement(difference, np.zeros(6), subjects=names)
    # means 2, 6, 5 about 25/6; within 2 + 26 on 3; divisor (36 − 14) / (2 · 6)
    between = (2 * (2 - 25 / 6) ** 2 + (6 - 25 / 6) ** 2 + 3 * (5 - 25 / 6) ** 2) / 2
    within = 28.0 / 3.0
    persons = max((between - within) / (22.0 / 12.0), 0.0)
    assert persons == 0.0
    assert limits.sd == pytest.approx(np.sqrt(within))
    difference[2] = 30.0
    limits = evaluate.limits_of_agreement(difference, np.zeros(6), subjects=names)
    mean = 49 / 6
    between = (2 * (2 - mean) ** 2 + (30 - mean) ** 2 + 3 * (5 - mean) ** 2) / 2
    persons = (between - within) / (22.0 / 12.0)
    assert limits.sd == pytest.approx(np.sqrt(persons + within))
    assert limits.bias == pytest.approx(mean)
    half = stats.t.ppf(0.975, 2) * np.sqrt(persons * 14 / 36 + within / 6)
    np.testing.assert_allclose([limits.bias_low, limits.bias_high], [mean - half, mean + half])
    assert limits.upper - limits.lower == pytest.approx(2 * 1.959964 * limits.sd)


def test_limits_of_unbalanced_repeats_find_the_variance_and_cover_it():
    truth = 0.01 + stats.norm.ppf(0.975) * np.hypot(0.03, 0.02)
    sd, upper, bias = [], [], []
    for seed in range(300):
        table = cohort(np.random.default_rng(seed).integers(1, 12, 15), seed=seed)
        limits = evaluate.limits_of_agreement(table["estimate"], table["reference"], subjects=table["subject"])
        sd.append(limits.sd)
        upper.append(limits.upper_low <= truth <= limits.upper_high)
        bias.append(limits.bias_low <= 0.01 <= limits.bias_high)
    assert np.mean(np.square(sd)) == pytest.approx(0.03**2 + 0.02**2, rel=0.08)
    # approximate intervals for unequal sizes: within 5 % of the nominal 95 %
    assert 0.90 <= np.mean(bias) <= 1.0
    assert 0.90 <= np.mean(upper) <= 1.0


# --- tables ---


def test_a_row_of_agreement_holds_what_its_parts_say():
    table = pd.concat([cohort([6, 3, 9, 5, 7]), cohort([1] * 9, seed=3, quantity="stride_width")], ignore_index=True)
    table.loc[[2, 7], "estimate"] = np.nan
    result = evaluate.agreement(table, seed=4, resamples=300)
    assert list(result.index) == ["stride_length", "stride_width"]
    assert tuple(result.columns) == evaluate.AGREEMENT
    length = table[table["quantity"] == "stride_length"].dropna(subset="estimate")
    row = result.loc["stride_length"]
    assert (row["n"], row["n_subjects"], row["n_dropped"]) == (28, 5, 2)
    limits = evaluate.limits_of_agreement(length["estimate"], length["reference"], subjects=length["subject"])
    error = length["error"].to_numpy()
    np.testing.assert_allclose(
        row[["bias", "bias_low", "bias_high", "loa_low", "loa_high", "rmse", "mae", "max_abs"]].astype(float),
        [limits.bias, limits.bias_low, limits.bias_high, limits.lower, limits.upper, np.sqrt(np.mean(error**2)),
         np.abs(error).mean(), np.abs(error).max()],
    )  # fmt: skip
    slow = {"seed": 4, "resamples": 300}
    np.testing.assert_allclose(
        row[["mae_low", "mae_high"]],
        over_subjects(length, lambda rows: rows["abs_error"].mean(), **slow),
    )
    assert row["icc"] == pytest.approx(icc(length["estimate"], length["reference"]).value)
    np.testing.assert_allclose(
        row[["icc_low", "icc_high"]],
        over_subjects(length, lambda rows: icc(rows["estimate"], rows["reference"]).value, **slow),
        rtol=1e-9,
    )
    width = table[table["quantity"] == "stride_width"]
    np.testing.assert_allclose(
        result.loc["stride_width", ["icc", "icc_low", "icc_high"]],
        icc(width["estimate"], width["reference"])[:3],
    )


def test_a_statistic_that_cannot_be_computed_is_nan():
    alone = evaluate.agreement(cohort([5]), resamples=20).iloc[0]
    assert (alone["n"], alone["n_subjects"]) == (5, 1)
    assert np.isfinite(alone[["bias", "rmse", "mae", "max_abs", "icc"]].astype(float)).all()
    assert alone[["bias_low", "loa_low", "loa_high", "mae_low", "icc_low"]].isna().all()
    none = evaluate.agreement(cohort([5]).assign(estimate=np.nan)).iloc[0]
    assert (none["n"], none["n_subjects"], none["n_dropped"]) == (0, 0, 5)
    assert none[["bias", "mae", "icc", "max_abs"]].isna().all()


def test_a_reference_that_does_not_vary_has_no_icc():
    same = evaluate.agreement(cohort([1] * 6).assign(reference=5.0)).iloc[0]
    assert same[["icc", "icc_low", "icc_high"]].isna().all() and np.isfinite(same["loa_high"])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: evaluate.agreement(cohort([2, 2]), resamples=0), "resamples must be positive; got 0"),
        (lambda: evaluate.agreement(cohort([2, 2]).drop(columns="subject")), r"\['subject'\] missing"),
        (lambda: evaluate.agreement(cohort([2, 2]).assign(subject=["a", "a", None, "b"])), "1 of 4 have none"),
        (lambda: evaluate.paired_difference([1.0, 2.0], [1.0, np.nan], ["a", "b"], seed=0), "after must be finite"),
        (lambda: evaluate.paired_difference([1.0, 2.0], [1.0, 2.0], ["a", "a"], seed=0), "at least two subjects"),
        (lambda: evaluate.icc21(np.ones((3, 1))), r"n, k >= 2; got shape \(3, 1\)"),
        (lambda: evaluate.limits_of_agreement([1.0, 2.0, 3.0], [1.0, 2.0]), r"same n >= 2; got \(3,\) and \(2,\)"),
        (lambda: evaluate.limits_of_agreement([1.0, 2.0], [1.0, 2.0], subjects=["a", "a"]), "at least two subjects"),
    ],
)
def test_refusals_state_what_was_wrong(call, message):
    with pytest.raises(ValueError, match=message):
        call()
