"""The numbers of the model of doubt are found again from strides that were drawn with them."""

import numpy as np
import pytest

from experiments.quality.learn import interval, judged_by, learned, log_likelihood, to_dict
from experiments.quality.strides import Table
from experiments.quality.strides_left_out import calibration, shares
from jgait.quality import EVIDENCE, QualityParams, doubt, factor
from jgait.quality.model import WRONG, from_dict, weighted

ROWS = 6000
NAMES = ("innovation", "cramped")


def drawn() -> tuple[QualityParams, Table]:
    """Numbers, and strides whose errors have their density; each stride is a recording of its own."""
    draw = np.random.default_rng(8)
    spread, wrong = (np.zeros(len(EVIDENCE)) for _ in range(2))
    spread[EVIDENCE.index("innovation")], wrong[EVIDENCE.index("cramped")] = 0.4, 3.0
    p = QualityParams(0.2, spread, -4.0, wrong, 8.0)
    evidence = {name: draw.exponential(0.5, ROWS) for name in NAMES}
    stated = draw.uniform(0.01, 0.03, ROWS)
    off = draw.random(ROWS) < 1.0 / (1.0 + np.exp(-(p.odds + weighted(p.wrong, evidence))))
    error = draw.normal(size=ROWS) * factor(p, evidence, stated, np.ones(ROWS)) * stated * np.where(off, p.tail, 1.0)
    columns = np.stack([evidence.get(name, np.zeros(ROWS)) for name in EVIDENCE], axis=1)
    names = np.array([str(k) for k in range(ROWS)], dtype=object)
    group = np.full(ROWS, "set", dtype=object)
    return p, Table(group, group, names, names, error, stated, np.zeros(ROWS), np.ones(ROWS), columns)


def test_planted_numbers_are_learned_and_their_doubt_is_calibrated():
    p, table = drawn()
    found = learned(table)
    assert abs(found.shift - p.shift) < 0.1 and abs(found.odds - p.odds) < 0.5 and abs(found.tail / p.tail - 1.0) < 0.2
    for name, weight in (("innovation", 0.4), ("apart", 0.0)):
        assert abs(found.spread[EVIDENCE.index(name)] - weight) < 0.05
    assert abs(found.wrong[EVIDENCE.index("cramped")] - 3.0) < 0.4
    error, doubt = judged_by(found, table)
    assert calibration(error, doubt) < 0.01
    missed, false, off = shares(error, doubt)
    assert missed < off and false < 100.0
    assert np.mean(error <= interval(found, table)) > 0.949


def test_the_density_of_an_error_has_the_mass_one_and_the_doubt_is_its_mass_beyond_three_deviations():
    p, table = drawn()
    found = {name: table.evidence[:1, EVIDENCE.index(name)] for name in NAMES}
    spread = float(factor(p, found, 0.02, 1.2)[0]) * 0.02
    error = np.linspace(-60.0, 60.0, 240_001) * spread
    rows = {name: np.repeat(values, error.size) for name, values in found.items()}
    stated, length, reference = (np.full(error.size, number) for number in (0.02, 1.2, 0.0))
    mass = np.exp(log_likelihood(p, rows, error, stated, length, reference)) * (error[1] - error[0])
    assert float(mass.sum()) == pytest.approx(1.0, abs=1e-4)
    beyond = float(mass[np.abs(error) > WRONG * spread].sum())
    assert beyond == pytest.approx(float(doubt(p, found)[0]), abs=1e-4)


def test_numbers_written_and_read_are_the_same_up_to_their_digits():
    p = drawn()[0]
    for name, value in from_dict(to_dict(p))._asdict().items():
        np.testing.assert_allclose(value, getattr(p, name), atol=1e-4)
