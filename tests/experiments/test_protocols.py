"""The papers' protocols: distances and steps exact, rates and placements as printed, everyone valid, same key same
walk."""

import math

import jax
import numpy as np
import pytest

from experiments.common import protocols
from jgait import simulate

pytestmark = pytest.mark.release


def sound(walked, rate, placements, distance):
    """What holds of every protocol."""
    recording, truth, extra = walked
    estimate = truth.estimate
    assert recording.sampling_rate_hz == rate
    assert tuple(recording.sensors) == placements
    assert extra["distance"] == pytest.approx(distance, abs=1e-9)
    assert estimate.distance[-1] == pytest.approx(distance, abs=1e-8)
    assert int(np.sum(truth.strides.valid)) == extra["steps"] + 1  # the last closes up
    np.testing.assert_allclose(np.diff(estimate.time), 1.0 / rate, atol=1e-12)
    for imu in recording.sensors.values():
        assert imu.gyr.shape == imu.acc.shape == (estimate.time.size, 3)
        assert np.isfinite(imu.gyr).all() and np.isfinite(imu.acc).all()
        rest = imu.mask & (estimate.time < 2.0)
        assert np.linalg.norm(imu.acc[rest].mean(axis=0)) == pytest.approx(9.8, abs=1.2)  # m/s²
    for leg in estimate.legs:
        assert np.degrees(leg.knee_angle.min()) > 0.0
        assert 50.0 < np.degrees(leg.knee_angle.max()) < 100.0


@pytest.fixture(scope="module")
def short():
    return protocols.bennett(jax.random.key(0), 2)


def test_bennett_walks_three_to_four_metres_between_two_rests(short):
    for number, walked in enumerate(short):
        distance = walked.extra["distance"]
        assert 3.1 <= distance <= 4.0
        sound(walked, 50.0, simulate.FOUR, distance)
        assert walked.recording.subject == f"bennett_{number + 1:04d}"
        time, hip = walked.truth.estimate.time, walked.truth.estimate.legs.right.hip_angle
        assert np.ptp(hip[time < 2.5]) < 1e-9
        assert np.ptp(hip[time > time[-1] - 0.9]) < 1e-9
        own = walked.truth.estimate.diagnostics
        assert own["thigh_length"] == pytest.approx(walked.extra["person"].body.thigh_length)
        feet = [own[f"foot_displacement_{side}"][-1] for side in ("right", "left")]
        assert feet == pytest.approx([distance] * 2, abs=0.02)  # toes turned out, feet put down a little aside
    assert short[0].extra["distance"] != short[1].extra["distance"]


def test_the_routes_of_silva_have_their_printed_lengths():
    for name, length, turn in (("A", 127.6, 0.0), ("B", 42.05, 2.0 * math.pi), ("C", 136.1, 1.5 * math.pi)):
        route = protocols.silva_route(name)
        assert float(np.sum(route.length)) == pytest.approx(length, abs=1e-9)
        assert float(np.sum(route.turn)) == pytest.approx(turn)
        assert np.all(route.length > 0.0)
    hall = protocols.silva_route("B")
    end = simulate.routes.at(hall, np.array([42.05]))
    assert float(end.x[0]) == pytest.approx(0.0, abs=1e-9)  # round the hall, back to the start
    assert float(end.y[0]) == pytest.approx(0.0, abs=1e-9)
    stairs = protocols.silva_route("C")
    assert float(np.sum(stairs.riser)) == pytest.approx(0.0)
    assert float(np.abs(stairs.riser).max()) == 0.15


def test_potter_steps_on_marks_and_hears_the_other_leg():
    (walked,) = protocols.potter(jax.random.key(3), 1, straight=9.0, after=5.0)
    recording, truth, extra = walked
    sound(walked, 128.0, ("foot_right", "foot_left"), 14.0 + 0.4 * math.pi)
    plan, steps = truth.plan, extra["steps"]
    x, y = plan.x[1 : steps + 2], plan.y[1 : steps + 2]
    straight = x < 8.0
    forward, aside = np.diff(x[straight]), np.abs(np.diff(y[straight]))
    assert 0.5 * extra["person"].gait.stride_length == pytest.approx(0.61, rel=0.02)  # no whole number of them fits
    np.testing.assert_allclose(forward, 0.5 * extra["person"].gait.stride_length, atol=0.016)
    np.testing.assert_allclose(aside, 0.30, atol=0.04)
    # Seen in at least four strides of five, as the paper's was.
    time = truth.estimate.time[recording.feet_range.mask]
    contacts = plan.contact[2 : steps + 2]
    seen = [np.any((time > a) & (time < b)) for a, b in zip(contacts[:-2:2], contacts[2::2], strict=False)]
    assert np.mean(seen) > 0.8


def test_kose_walks_faster_on_every_piece():
    (walked,) = protocols.kose(jax.random.key(4), 1, piece=8.0, errors=protocols.RIGHT_SIDE._replace(mounting=0.0))
    sound(walked, 100.0, ("waist",), 24.0)
    time, distance = walked.truth.estimate.time, walked.truth.estimate.distance
    speeds = [np.polyfit(time[part], distance[part], 1)[0]
              for part in ((distance > 8.0 * k + 1.5) & (distance < 8.0 * k + 6.5) for k in range(3))]  # fmt: skip
    assert speeds[1] / speeds[0] == pytest.approx(1.15, rel=0.06)
    assert speeds[2] / speeds[0] == pytest.approx(1.30, rel=0.06)
    # Worn with x down: at rest it reads −g there.
    rest = walked.recording.sensors["waist"].acc[:200].mean(axis=0)
    assert rest[0] == pytest.approx(-9.81, abs=1.0)
    assert np.abs(rest[1:]).max() < 1.5
