"""A second recording, of another length, compiles nothing; programs are kept between processes."""

from typing import Any

import jax
import numpy as np
import pytest
from made import footsteps
from made.estimators import CASES

from jgait import estimators
from jgait.estimators import programs, stride_width_ekf
from jgait.types import Recording

compiled: list[str] = []
announced: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, seconds, **_: compiled.append(event) if event.endswith("backend_compile_duration") else None
)


def shorter(recording: Recording, samples: int) -> Recording:
    """The recording without its last samples."""
    sensors = {
        name: type(imu)(*(None if field is None else field[:-samples] for field in imu))
        for name, imu in recording.sensors.items()
    }
    return recording._replace(sensors=sensors)


def of_feet(seed: int, before: int) -> Any:
    walk = footsteps.drifting(footsteps.footsteps(seed, before=before, turn=2, after=5), seed)
    return stride_width_ekf.prepare_from_feet(walk.time, walk.feet, walk.mids, walk.read)


@pytest.mark.parametrize("name", estimators.names())
def test_a_recording_of_another_length_compiles_nothing(name):
    case, record = CASES[name](), estimators.get(name)
    if case.recording is None:
        ready = [of_feet(3, 9), of_feet(4, 8)]
    else:
        record = estimators.get(name, options=case.options) if name == "duty_cycled_gyro" else record
        ready = []
        for recording in (case.recording, shorter(case.recording, 77)):
            compiled.clear()
            ready.append(record.prepare(recording))
        assert compiled == []  # nor do decisions about a recording
    assert ready[0].options == ready[1].options
    assert ready[0].inputs.time.size != ready[1].inputs.time.size
    one = record.solve(record.params, ready[0])
    compiled.clear()
    other = record.solve(record.params, ready[1])
    assert compiled == []
    assert (one.time.size, other.time.size) == tuple(made.inputs.time.size for made in ready)


def double(x: Any, *, options: float) -> Any:
    return options * np.pi * x


@pytest.fixture
def folder(tmp_path):
    programs.keep(tmp_path)
    programs.before_compiling(lambda: announced.append("compiling"))
    yield tmp_path
    programs.before_compiling(None)
    programs.keep(None)


def made(x: Any, options: float = 2.0) -> Any:
    """The result of a program that is new to this process."""
    announced.clear()
    return programs.Program(double)(x, options=options)


def test_a_kept_program_is_loaded_and_not_compiled(folder):
    x = np.arange(5.0)
    first = made(x)
    assert announced
    np.testing.assert_array_equal(made(x), first)
    assert announced == []
    made(x, options=3.0)
    assert announced  # other options, and below another shape
    made(np.arange(6.0))
    assert announced
    assert len(list(folder.iterdir())) == 3


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b[:40] + bytes(8) + b[48:], lambda b: b""])
def test_a_damaged_program_is_compiled_anew(folder, damage):
    x = np.arange(5.0)
    first = made(x)
    (file,) = folder.iterdir()
    file.write_bytes(damage(file.read_bytes()))
    np.testing.assert_array_equal(made(x), first)
    assert announced
    made(x)
    assert announced == []


def test_a_folder_that_cannot_be_written_costs_nothing_but_the_keeping(folder):
    programs.keep(folder / "absent")
    np.testing.assert_array_equal(made(np.ones(2)), 2.0 * np.pi * np.ones(2))


def test_the_folder_loses_what_was_not_used_for_longest(folder):
    for number in range(4):
        (folder / str(number)).write_bytes(bytes(10))
    for number, second in enumerate((3, 1, 4, 2)):
        programs.os.utime(folder / str(number), (second, second))
    programs.shortened(folder, 25)
    assert sorted(path.name for path in folder.iterdir()) == ["0", "2"]
