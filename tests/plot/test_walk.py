"""Pictures of a walk show the body and the signals that are there, and refuse what is not."""

import jax
import numpy as np
import pytest

from jgait import plot, simulate
from jgait.plot.walk import BODY
from jgait.simulate import Gait, Person


@pytest.fixture(scope="module")
def walked():
    person = Person(gait=Gait(steps=4.0, quiet_before=0.5, quiet_after=0.3))
    return person, *simulate.recording(jax.random.key(0), person, rate=50.0)


def test_the_body_is_drawn_with_its_lengths_and_the_feet_on_the_ground(walked):
    person, _, truth = walked
    body = person.body
    animation = plot.stick_figure(truth)
    side, front = animation._fig.axes
    animation._init_draw()
    for frame in (0, 30):
        animation._draw_frame(frame)
        for name in ("right", "left"):
            seen = [
                next(line for line in axis.lines if line.get_color() == BODY[name]["color"]) for axis in (side, front)
            ]
            x, z = seen[0].get_data()
            y, z_again = seen[1].get_data()
            np.testing.assert_array_equal(z, z_again)
            points = np.stack([x, y, z], axis=1)
            lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
            heel = np.hypot(body.heel_length, body.ankle_height)
            wanted = [body.thigh_length, body.shank_length, heel, body.heel_length + body.ball_length]
            np.testing.assert_allclose(lengths[:4], wanted, rtol=0, atol=1e-9)
            assert points[:, 2].min() > -0.01


def test_a_gif_is_as_long_as_the_walk(walked, tmp_path):
    from PIL import Image

    samples = len(walked[2].estimate.time)
    truth = jax.tree.map(lambda v: v[:40] if np.ndim(v) and len(v) == samples else v, walked[2])  # the first 0.8 s
    plot.stick_figure(truth, tmp_path / "walk.gif")
    assert [one.name for one in tmp_path.iterdir()] == ["walk.gif"]
    with Image.open(tmp_path / "walk.gif") as image:
        assert image.info["duration"] == 40
        assert image.n_frames == pytest.approx(25.0 * np.ptp(truth.estimate.time) + 1.0, abs=1.0)


def test_every_sensor_is_drawn_over_one_stride_with_its_contacts(walked):
    _, recording, truth = walked
    rows = np.flatnonzero(truth.strides.valid)
    stride = int(rows[len(rows) // 2])
    start, end = truth.strides.start[stride], truth.strides.end[stride]
    axes = np.array(plot.stride_signals(recording, truth).axes).reshape(-1, 2)
    assert [axis.get_ylabel().replace("\n", "_") for axis in axes[:, 0]][:2] == ["pelvis", "thigh_right"]
    assert len(axes) == len(recording.sensors)
    imu = recording.sensors["foot_left"]
    row = next(pair for pair in axes if pair[0].get_ylabel() == "foot\nleft")
    for axis, values in zip(row, (imu.gyr, imu.acc), strict=True):
        lines = [line for line in axis.lines if len(line.get_xdata()) > 2]
        inside = (imu.time >= start) & (imu.time <= end)
        np.testing.assert_allclose(lines[1].get_ydata(), values[inside, 1], rtol=1e-12)
        upright = [line.get_xdata()[0] for line in axis.lines if len(line.get_xdata()) == 2]
        assert min(abs(at - 100.0) for at in upright) < 1e-9


def test_what_was_lost_or_not_measured_is_not_drawn(walked):
    _, recording, truth = walked
    imu = recording.sensors["pelvis"]
    lost = imu._replace(acc=None, mask=np.zeros_like(imu.mask))
    figure = plot.stride_signals(recording._replace(sensors={"pelvis": lost}), truth)
    gyr, acc = figure.axes
    drawn = [line.get_ydata() for line in gyr.lines if len(line.get_xdata()) > 2]
    assert len(drawn) == 3
    assert np.isnan(drawn).all()
    assert [text.get_text() for text in acc.texts] == ["not measured"]


def test_a_walk_without_strides_is_refused(walked):
    _, recording, truth = walked
    none = truth._replace(
        estimate=truth.estimate._replace(strides=truth.strides._replace(valid=np.zeros_like(truth.strides.valid)))
    )
    with pytest.raises(ValueError, match="no stride"):
        plot.stride_signals(recording, none)
