"""Closing steps of walking bouts, made of contacts and standing alone; and what is not known of a person."""

import numpy as np
import pytest

from jgait.estimators.waist import WaistParams, with_body
from jgait.estimators.waist.bouts import CLOSING, bouts, leave_out
from jgait.estimators.waist.bouts import nodes as columns_of
from jgait.estimators.waist.readout import constant_variance
from jgait.events.trunk import Contacts

RATE, STEP = 100.0, 0.5


def nodes(steps, stands_s):
    """The nodes of one bout whose contacts are at these steps after 2 s, right and left in turn, before standing."""
    time = 2.0 + STEP * np.asarray(steps, float)
    side, every = np.arange(time.size) % 2, np.ones(time.size)
    contacts = Contacts(time, side, every > 0.0, time, every / STEP, 0.9 * every)
    (bout,) = bouts(contacts, [(0, 150), (round(stands_s * RATE), round(stands_s * RATE) + 200)], RATE)
    return bout


def test_a_contact_found_in_time_closes_the_bout():
    bout = nodes([0, 1, 2, 3, 3.95], 4.8)
    assert [node.contact for node in bout] == [False, *[True] * 5, False]
    assert bout[-2].at == pytest.approx(RATE * (2.0 + 3.95 * STEP))
    assert bout[-2].likely == pytest.approx(0.95)


def test_the_settling_after_the_closing_step_is_not_its_contact():
    bout = nodes([0, 1, 2, 3, 4.4], 5.0)
    assert sum(node.contact for node in bout) == 5
    assert bout[-2].at == pytest.approx(RATE * (2.0 + (3.0 + CLOSING) * STEP))


def test_a_closing_step_without_a_jolt_comes_between_the_last_contact_and_standing():
    bout = nodes([0, 1, 2, 3], 4.7)  # 2.4 steps after the last contact
    assert sum(node.contact for node in bout) == 5
    assert bout[-2].at == pytest.approx(RATE * (2.0 + (3.0 + CLOSING) * STEP))
    assert (bout[-2].side, bout[-2].step, bout[-2].stands, bout[-1].stands) == (0, True, False, True)
    # who stands still sooner has closed the step before
    assert sum(node.contact for node in nodes([0, 1, 2, 3], 4.4)) == 4


def test_an_unknown_height_is_a_wider_deviation():
    unknown, person, sensor = (
        constant_variance(with_body(WaistParams(), body)) for body in ({}, {"height": 1.6}, {"sensor_height": 0.96})
    )
    assert unknown > person > sensor > WaistParams().pendulum_constant_sd ** 2


@pytest.mark.parametrize("lost_s, left", [(0.2, 2), (0.4, 0)])
def test_strides_that_lose_too_much_are_left_out(lost_s, left):
    time = np.arange(0.0, 7.0, 1.0 / RATE)
    columns = columns_of([nodes([0, 1, 2, 3], 4.4)], time)
    assert columns["stride"].sum() == 2
    lost = (time > 2.6) & (time < 2.6 + lost_s)  # within both strides
    assert leave_out(columns, lost, time) == 2 - left
    assert columns["stride"].sum() == left


def test_a_stride_that_begins_in_a_loss_is_left_out():
    time = np.arange(0.0, 7.0, 1.0 / RATE)
    columns = columns_of([nodes([0, 1, 2, 3], 4.4)], time)
    assert leave_out(columns, np.abs(time - 2.0) < 0.05, time) == 1
    assert list(np.flatnonzero(columns["stride"])) == [4]
