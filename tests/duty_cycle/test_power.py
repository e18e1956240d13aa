"""What a sleeping sensor costs: the paper's Table 2, masks against closed forms, and the smooth form."""

import numpy as np
import pytest

from jgait.duty_cycle import power
from jgait.duty_cycle.power import ACCELEROMETER, GYROSCOPE, Battery, Schedule, Sensor

RATE = 50.0
TABLE_2 = {90: 8.57, 80: 17.14, 70: 28.57, 60: 37.14, 50: 42.86, 40: 57.14, 30: 68.57, 20: 77.14, 10: 88.57}
"""Duty cycle → energy saving, both in percent, as printed."""


@pytest.mark.parametrize(("duty", "printed"), TABLE_2.items())
def test_the_paper_s_savings_to_the_last_digit(duty, printed):
    schedule = power.schedule_of_duty(duty / 100)
    assert 100.0 * power.saving(schedule) == pytest.approx(printed, abs=0.005)
    # The same from the samples of 14 s at 50 Hz, where every edge falls on a sample.
    used = power.masks(schedule, 700, RATE)
    always = GYROSCOPE.on * 14.0
    assert 100.0 * (1.0 - float(power.mask_energy(used, RATE)) / always) == pytest.approx(printed, abs=0.005)
    assert used.usable.mean() == pytest.approx(duty / 100)
    assert schedule.duty == pytest.approx(duty / 100)


def test_a_schedule_of_any_sensor_by_hand_and_one_that_never_sleeps():
    schedule = power.schedule_of_duty(1.0)
    assert power.saving(schedule) == 0.0
    assert power.mean_power(schedule, ACCELEROMETER) == ACCELEROMETER.on
    assert power.masks(schedule, 20, RATE).usable.all()
    sensor = Sensor(on=10e-3, off=1e-3, wake_up=0.5)
    # 2 s on, 3 s off of which half a second wakes: (20 + 5 + 2.5) mJ in 5 s.
    assert power.mean_power(Schedule(2, 3, 1.0), sensor) == pytest.approx(27.5e-3 / 5.0)
    energy = power.mask_energy(power.masks(Schedule(2, 3, 1.0), 500, RATE, sensor), RATE, sensor)
    assert float(energy) == pytest.approx(10.0 * power.mean_power(Schedule(2, 3, 1.0), sensor))


def test_battery_life_of_two_sensors():
    battery = Battery.from_watt_hours(0.1)
    assert battery.energy == 360.0
    assert battery.life(GYROSCOPE.on, ACCELEROMETER.on) == pytest.approx(360.0 / 32.7e-3)
    slept = power.mean_power(power.schedule_of_duty(0.1))
    assert battery.life(slept, ACCELEROMETER.on) == pytest.approx(360.0 / (0.1142857142857e0 * 30e-3 + 2.7e-3))


def test_switching_at_will_agrees_with_the_schedule_and_with_a_loop():
    schedule = Schedule(1, 2, 0.6)
    used = power.masks(schedule, 400, RATE)
    # The wake-up for an on-time behind the end is in the schedule, and cannot be known from the samples wanted.
    inside = slice(0, 360)
    np.testing.assert_array_equal(power.powered_for(used.usable, RATE)[inside], used.powered[inside])
    rng = np.random.default_rng(5)
    powered = np.repeat(rng.random(40) < 0.6, rng.integers(1, 25, 40))
    lead = 10
    wanted = np.concatenate([powered, np.zeros(lead, bool)])
    expected = [wanted[i : i + lead + 1].any() for i in range(powered.size)]
    np.testing.assert_array_equal(power.powered_for(powered, RATE), expected)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        *(
            (lambda duty=duty: power.schedule_of_duty(duty), r"duty must lie in \(0, 1\]")
            for duty in (0.0, -0.2, 1.2, 40.0, float("nan"))
        ),
        (lambda: power.schedule_of_duty(0.1, unit=0.1), r"longer than its on-time of 0\.1 s"),
        (
            lambda: power.mean_power(Schedule(9, 1, 0.15)),
            r"longer than its off-time of 0\.15 s: it would never be off",
        ),
        (lambda: power.schedule_of_duty(0.33), "at most 10 units has a duty cycle of 0.33; the nearest is 1/3"),
        (lambda: power.saving(Schedule(1, -1)), "off must be a whole number of units"),
        (lambda: power.saving(Schedule(0, 1)), "on must be a whole number of units from 1 up"),
        (lambda: power.saving(Schedule(1, 1, 0.0)), "unit must be a positive number"),
        (
            lambda: power.saving(Schedule(1, 1), Sensor(on=-1.0)),
            r"on of a sensor must be finite and not negative \[W\]",
        ),
        (lambda: power.masks(Schedule(1, 1), 10, 0.0), "rate_hz must be positive"),
    ],
)
def test_what_a_sensor_cannot_follow_is_refused_with_the_reason(call, message):
    with pytest.raises(ValueError, match=message):
        call()
    assert power.mean_power(Schedule(1, 5, 0.2)) == pytest.approx(GYROSCOPE.on / 3.0)
