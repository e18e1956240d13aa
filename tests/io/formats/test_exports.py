"""Parameters of strides under gaitmap's names, contacts, strides and bouts under mobgap's."""

import numpy as np
import pytest
from made import tables as made_tables

from jgait import io

RATE = made_tables.RATE


def test_gaitmaps_parameters_are_those_of_its_stride_list():
    estimate = made_tables.estimate()
    found, lists = io.to_gaitmap_parameters(estimate, RATE), io.to_gaitmap(estimate, RATE)
    assert list(found) == list(lists)
    for sensor, table in found.items():
        assert list(table.index) == list(lists[sensor].index) and table.index.name == "s_id"
        assert len(table) == made_tables.STRIDES
    right = found["right_sensor"]
    np.testing.assert_allclose(right["stride_length"], made_tables.LENGTH)
    np.testing.assert_allclose(right["gait_velocity"], made_tables.LENGTH / made_tables.CYCLE)
    np.testing.assert_allclose(right["turning_angle"], np.rad2deg(made_tables.TURN))
    np.testing.assert_allclose(right["stance_time"] + right["swing_time"], right["stride_time"])
    np.testing.assert_allclose(right["max_sensor_lift"], made_tables.HIGHEST, atol=1e-4)
    assert (right["tc_angle"] < 0).all() and (right["ic_angle"] > 0).all()


def test_mobgaps_contacts_strides_and_bouts():
    estimate = made_tables.estimate(pause=4.0)
    contacts, strides, bouts = io.to_mobgap(estimate, RATE)
    assert contacts.index.name == "step_id" and list(contacts.columns) == ["ic", "lr_label"]
    assert contacts["ic"].is_monotonic_increasing and contacts["ic"].dtype == np.int64
    assert list(contacts["lr_label"].cat.categories) == ["left", "right"]
    # Each foot's contacts are one more than its strides in each of two bouts.
    assert (contacts["lr_label"] == "right").sum() == made_tables.STRIDES + 2
    assert strides.index.names == ["wb_id", "s_id"] and list(bouts.index) == [0, 1]
    assert list(bouts["n_strides"]) == [2 * made_tables.AFTER, 2 * (made_tables.STRIDES - made_tables.AFTER)]
    np.testing.assert_allclose(strides["cadence_spm"], 120 / made_tables.CYCLE)
    np.testing.assert_allclose(bouts["stride_length_m"], made_tables.LENGTH)
    np.testing.assert_allclose(bouts["walking_speed_mps"], made_tables.LENGTH / made_tables.CYCLE)
    np.testing.assert_allclose(bouts["duration_s"], (bouts["end"] - bouts["start"]) / RATE)
    one = io.to_mobgap(made_tables.estimate(pause=2.0), RATE).per_wb_parameters
    assert list(one["n_strides"]) == [2 * made_tables.STRIDES]


def test_a_first_stride_from_standing_is_none_of_mobgaps():
    estimate = made_tables.estimate()
    strides = estimate.strides
    standing = np.array(strides.standing)
    standing[0] = strides.start[0] - 0.3
    less = io.to_mobgap(estimate._replace(strides=strides._replace(standing=standing)), RATE)
    every = io.to_mobgap(estimate, RATE)
    assert len(less.per_stride_parameters) == len(every.per_stride_parameters) - 1
    assert len(less.ic_list) == len(every.ic_list) - 1


def test_a_half_step_counts_in_no_mean_of_mobgaps():
    """Its length, which is below 0, is not known to mobgap, and neither is it to those who average the strides."""
    estimate = made_tables.estimate()
    length = np.array(estimate.strides.length)
    length[3] = -0.017
    strides = estimate.strides._replace(length=length)
    half = np.arange(len(length)) == 3
    changed = estimate._replace(strides=strides, diagnostics={"half": half, "doubtful": half})
    _, table, bouts = io.to_mobgap(changed, RATE)
    assert (~table["regular"]).sum() == 1 and table["stride_length_m"].isna().sum() == 1
    assert not (table["stride_length_m"] <= 0.0).any()
    np.testing.assert_allclose(bouts["stride_length_m"], made_tables.LENGTH)
    assert list(bouts["n_strides"]) == [2 * made_tables.STRIDES]


def test_nobody_walks_and_nothing_is_known():
    estimate = made_tables.estimate()
    nobody = estimate._replace(strides=estimate.strides._replace(valid=np.zeros(len(estimate.strides.side), bool)))
    for table in io.to_mobgap(nobody, RATE):
        assert table.empty
    assert io.to_mobgap(nobody, RATE).ic_list["ic"].dtype == np.int64
    assert all(table.empty for table in io.to_gaitmap_parameters(nobody, RATE).values())
    with pytest.raises(ValueError, match="need contacts; these have no start_s, end_s"):
        io.to_mobgap(made_tables.estimate(start=None, end=None, final_contact=None), RATE)
    with pytest.raises(ValueError, match="sampling_rate_hz must be positive"):
        io.to_mobgap(estimate, 0.0)
