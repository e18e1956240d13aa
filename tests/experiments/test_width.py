"""The quick form of the stride width's experiment: the paper's walk in simulation, a metre or two of it."""

import math

import pytest

from experiments.potter import table1

pytestmark = pytest.mark.release


def test_the_papers_walk_in_its_quick_form():
    rows = {row.metric: row for row in table1.rows(True)}
    assert rows["sim_z1_mean_m_section1"].value < 0.02
    assert rows["sim_z1_mean_m_section1"].paper == 0.2461
    assert rows["sim_width_mae_cm"].value < 2.0
    assert rows["sim_width_mae_cm"].n > 10
    assert all(math.isfinite(row.value) for row in rows.values())
