"""Damages of a recording as a lab meets them, done to the rows of one sensor, or of all, before they are read."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from jgait.io import recording_from_arrays
from jgait.types import Recording

GRAVITY = 9.80665
FIRST_S = 0.45
"""[1] Share of the recording before the first damaged sample: the person walks there."""


class Rows(NamedTuple):
    """The rows of a file: what a lab hands to a reader.

    Attributes:
        sensors: placement → {"gyr": (T, 3) [deg/s], "acc": (T, 3) [m/s²]}.
        time: (T,) time stamps [s], or None.
        rate_hz: sampling rate that the file states [Hz].
        feet_range: (T,) [m], NaN where it was not measured, or None.
        when: (T,) true time of each row [s].
    """

    sensors: dict[str, dict[str, np.ndarray]]
    time: np.ndarray | None
    rate_hz: float | None
    feet_range: np.ndarray | None
    when: np.ndarray

    def true_time(self, time: np.ndarray) -> np.ndarray:
        """True times [s] of an estimate's times (n,) [s]."""
        stated = np.arange(len(self.when)) / self.rate_hz if self.time is None else self.time - self.time[0]
        return np.interp(time - time[0], stated, self.when)


class Damage(NamedTuple):
    """One way to damage a recording.

    Attributes:
        change: (rows, placement, random numbers) → damaged rows.
        everywhere: whether all sensors are damaged, so that a note need not name one.
        together: whether only an estimate from all sensors can show the damage.
    """

    change: Callable[[Rows, str, np.random.Generator], Rows]
    everywhere: bool = False
    together: bool = False


def rows_of(recording: Recording, placements: tuple[str, ...]) -> Rows:
    """The rows of a file of some sensors of a recording; lost samples are NaN."""

    def lost(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
        return np.where(np.asarray(mask)[:, None], np.asarray(values, np.float64), np.nan)

    sensors = {}
    for placement in placements:
        imu = recording.sensors[placement]
        sensors[placement] = {"gyr": np.rad2deg(lost(imu.gyr, imu.mask)), "acc": lost(imu.acc, imu.mask)}
    time = np.asarray(recording.sensors[placements[0]].time, np.float64)
    apart = recording.feet_range
    distance = None if apart is None else np.where(np.asarray(apart.mask), np.asarray(apart.distance), np.nan)
    return Rows(sensors, time, None, distance, time - time[0])


def read(rows: Rows, name: str) -> Recording:
    """The recording that a reader makes of the rows; raises RecordingError where it refuses them."""
    return recording_from_arrays(
        rows.sensors, time=rows.time, sampling_rate_hz=rows.rate_hz, feet_range=rows.feet_range, name=name
    )


def _rate(rows: Rows) -> float:
    return float(rows.rate_hz or 1.0 / np.median(np.diff(rows.time)))


def _first(rows: Rows) -> int:
    return int(FIRST_S * len(next(iter(rows.sensors.values()))["gyr"]))


def _with(rows: Rows, placement: str, signals: Mapping[str, np.ndarray]) -> Rows:
    return rows._replace(sensors={**rows.sensors, placement: {**rows.sensors[placement], **signals}})


def _kept(rows: Rows, kept: np.ndarray, *, stamps: bool) -> Rows:
    """Some rows (a mask or their numbers); without stamps, time goes on as if nothing were missing."""
    rate = _rate(rows)
    sensors = {p: {kind: values[kept] for kind, values in signals.items()} for p, signals in rows.sensors.items()}
    apart = None if rows.feet_range is None else rows.feet_range[kept]
    if stamps:
        return Rows(sensors, rows.time[kept], None, apart, rows.when[kept])
    return Rows(sensors, None, rate, apart, rows.when[kept])


def signal(kinds: str, change: Callable[[np.ndarray, np.random.Generator, int, float], np.ndarray]) -> Damage:
    """A change of the gyroscope ("gyr"), the accelerometer ("acc") or both ("gyr acc") of one sensor.

    `change` takes the values (T, 3), random numbers, the first sample to damage, and the rate [Hz].
    """

    def done(rows: Rows, placement: str, draw: np.random.Generator) -> Rows:
        seed = int(draw.integers(2**31))  # the same rows of both signals
        signals = {
            kind: change(rows.sensors[placement][kind].copy(), np.random.default_rng(seed), _first(rows), _rate(rows))
            for kind in kinds.split()
        }
        return _with(rows, placement, signals)

    return Damage(done)


def gap(seconds: float) -> Damage:
    """Cells of one sensor are empty."""
    return signal("gyr acc", lambda v, _, at, rate: _put(v, at, seconds, rate, np.nan))


def held(seconds: float, kinds: str = "gyr acc") -> Damage:
    """A sensor repeats its last reading."""
    return signal(kinds, lambda v, _, at, rate: _put(v, at, seconds, rate, v[at]))


def stuck(seconds: float) -> Damage:
    """An axis of a gyroscope repeats its last reading."""

    def change(values: np.ndarray, _: np.random.Generator, at: int, rate: float) -> np.ndarray:
        values[at : at + round(seconds * rate), 1] = values[at, 1]
        return values

    return signal("gyr", change)


def _put(values: np.ndarray, at: int, seconds: float, rate: float, value: np.ndarray | float) -> np.ndarray:
    values[at : at + round(seconds * rate)] = value
    return values


def cells(kinds: str, value: float, number: int = 1, axis: int | None = 1) -> Damage:
    """Some cells, or whole rows for axis None, hold a value."""

    def change(values: np.ndarray, draw: np.random.Generator, at: int, rate: float) -> np.ndarray:
        del rate
        where = at if number == 1 else draw.integers(at, len(values) - 100, number)
        sign = 1.0 if number == 1 or value in (-999.0,) else draw.choice([-1.0, 1.0], number)
        if axis is None:
            values[where] = value
        else:
            values[where, axis] = value * sign
        return values

    return signal(kinds, change)


def wrapped(limit: float) -> Callable[..., np.ndarray]:
    """Beyond a limit, readings go on at its other side."""
    return lambda v, *_: (v + limit) % (2.0 * limit) - limit


def clipped(limit: float) -> Callable[..., np.ndarray]:
    """Beyond a limit, readings stay at it."""
    return lambda v, *_: np.clip(v, -limit, limit)


def times(factor: tuple[float, float, float] | float) -> Callable[..., np.ndarray]:
    """Every axis is multiplied."""
    return lambda v, *_: v * np.asarray(factor)


def late(seconds: float, fast: float = 0.0) -> Callable[..., np.ndarray]:
    """Readings come late, or on a clock that runs fast by a share."""

    def change(values: np.ndarray, _: object, at: int, rate: float) -> np.ndarray:
        del at
        time = np.arange(len(values)) / rate
        known = np.isfinite(values).all(axis=1)
        wanted = time * (1.0 - fast) - seconds
        return np.stack([np.interp(wanted, time[known], column[known]) for column in values.T], axis=1)

    return change


def stepped(rows: Rows, placement: str, draw: np.random.Generator, seconds: float) -> Rows:
    """The stamps jump, and no sample is missing."""
    del placement, draw
    return rows._replace(time=rows.time + seconds * (np.arange(len(rows.time)) >= _first(rows)))


def stamps(change: Callable[[np.ndarray, np.random.Generator, float], np.ndarray]) -> Damage:
    """The time stamps change."""
    return Damage(lambda r, _, draw: r._replace(time=change(r.time, draw, _rate(r))), everywhere=True)


def without(share: float, *, stamped: bool) -> Damage:
    """A share of the rows is missing, at random."""
    return Damage(lambda r, _, draw: _kept(r, draw.random(len(r.time)) >= share, stamps=stamped), everywhere=True)


def twice(share: float) -> Damage:
    """A share of the rows is written twice, at random, without stamps."""

    def done(rows: Rows, _: str, draw: np.random.Generator) -> Rows:
        times = 1 + (draw.random(len(rows.time)) < share)
        return _kept(rows, np.repeat(np.arange(len(times)), times), stamps=False)

    return Damage(done, everywhere=True)


def cut(seconds: float, *, stamped: bool) -> Damage:
    """All rows of some time are missing."""

    def done(rows: Rows, _: str, draw: np.random.Generator) -> Rows:
        del draw
        row, at = np.arange(len(rows.time)), _first(rows)
        return _kept(rows, (row < at) | (row >= at + seconds * _rate(rows)), stamps=stamped)

    return Damage(done, everywhere=True)


def called(factor: float) -> Damage:
    """The file has no stamps and states a wrong rate."""
    return Damage(lambda r, *_: r._replace(time=None, rate_hz=factor * _rate(r)), everywhere=True)


def every(number: int) -> Damage:
    """One row in so many."""

    def done(rows: Rows, *_: object) -> Rows:
        return _kept(rows, np.arange(0, len(rows.time), number), stamps=True)

    return Damage(done, everywhere=True)


def gained(factor: float, last: float | None = None) -> Damage:
    """All gyroscopes are multiplied: by a factor, or by one that grows to `last` until the end."""

    def done(rows: Rows, *_: object) -> Rows:
        gain = np.linspace(factor, factor if last is None else last, len(rows.when))[:, None]
        return rows._replace(sensors={p: {**s, "gyr": gain * s["gyr"]} for p, s in rows.sensors.items()})

    return Damage(done, everywhere=True)


def called_on(other: str, instead: str) -> Damage:
    """A sensor is called as if worn on another segment, whose own sensor is left out; on a third one if it is there."""

    def done(rows: Rows, placement: str, _: np.random.Generator) -> Rows:
        segment, _, side = placement.partition("_")
        name = instead if segment == other else other
        name = name if name == "lower_back" else f"{name}_{side or 'right'}"
        kept = {each: values for each, values in rows.sensors.items() if each not in (placement, name)}
        return rows._replace(sensors={**kept, name: rows.sensors[placement]})

    return Damage(done, everywhere=True, together=True)


def repeated(values: np.ndarray, *_: object) -> np.ndarray:
    """Every second reading repeats the one before: a sensor at half the rate."""
    return np.repeat(values[::2], 2, axis=0)[: len(values)]


DAMAGES: dict[str, Damage] = {
    "gap of 0.2 s": gap(0.2),
    "gap of 0.5 s": gap(0.5),
    "gap of 1 s": gap(1.0),
    "gap of 3 s": gap(3.0),
    "rows of 0.5 s missing, with stamps": cut(0.5, stamped=True),
    "rows of 2 s missing, with stamps": cut(2.0, stamped=True),
    "rows of 0.5 s missing, without stamps": cut(0.5, stamped=False),
    "5 % of rows missing, with stamps": without(0.05, stamped=True),
    "5 % of rows missing, without stamps": without(0.05, stamped=False),
    "2 % of rows missing, without stamps": without(0.02, stamped=False),
    "2 % of rows written twice, without stamps": twice(0.02),
    "20 % of rows missing, without stamps": without(0.2, stamped=False),
    "one cell of 1e6, gyr": cells("gyr", 1e6),
    "one cell of 1e6, acc": cells("acc", 1e6),
    "one cell of -999, gyr": cells("gyr", -999.0),
    "one cell of -999, acc": cells("acc", -999.0),
    "ten rows of -999": cells("gyr acc", -999.0, 10, None),
    "20 spikes of 1900 deg/s": cells("gyr", 1900.0, 20),
    "20 spikes of 150 m/s²": cells("acc", 150.0, 20),
    "30 rows of zeros": cells("gyr acc", 0.0, 30, None),
    "frozen for 0.5 s": held(0.5),
    "frozen for 3 s": held(3.0),
    "gyroscope frozen for 1 s": held(1.0, "gyr"),
    "an axis of the gyroscope stuck for 1 s": stuck(1.0),
    "zeros for 0.5 s": signal("gyr acc", lambda v, _, at, rate: _put(v, at, 0.5, rate, 0.0)),
    "gyroscope wraps at 250 deg/s": signal("gyr", wrapped(250.0)),
    "gyroscope wraps at 125 deg/s": signal("gyr", wrapped(125.0)),
    "gyroscope clips at 250 deg/s": signal("gyr", clipped(250.0)),
    "gyroscope clips at 125 deg/s": signal("gyr", clipped(125.0)),
    "accelerometer wraps at 2 g": signal("acc", wrapped(2.0 * GRAVITY)),
    "accelerometer clips at 2 g": signal("acc", clipped(2.0 * GRAVITY)),
    "clock jumps by 0.4 s": Damage(lambda r, p, d: stepped(r, p, d, 0.4), everywhere=True),
    "clock jumps by 3 s": Damage(lambda r, p, d: stepped(r, p, d, 3.0), everywhere=True),
    "stamps jitter by a third": stamps(lambda t, d, rate: t + d.uniform(-0.3, 0.3, t.size) / rate),
    "stamps in steps of 50 ms": stamps(lambda t, _, rate: np.floor(t * 20.0) / 20.0 + np.arange(t.size) * 1e-9),
    "gyroscope's sign": signal("gyr", times(-1.0)),
    "accelerometer's sign": signal("acc", times(-1.0)),
    "gyroscope's x turned round": signal("gyr", times((-1.0, 1.0, 1.0))),
    "gyroscope's y turned round": signal("gyr", times((1.0, -1.0, 1.0))),
    "gyroscope's z turned round": signal("gyr", times((1.0, 1.0, -1.0))),
    "left-handed axes": signal("gyr acc", times((1.0, -1.0, 1.0))),
    "gyroscope's x and y exchanged": signal("gyr", lambda v, *_: v[:, [1, 0, 2]]),
    "gyroscope by 0.5": signal("gyr", times(0.5)),
    "gyroscope by 2": signal("gyr", times(2.0)),
    "gyroscope in rad/s": signal("gyr", times(np.pi / 180.0)),
    "accelerometer by 0.85": signal("acc", times(0.85)),
    "accelerometer in g": signal("acc", times(1.0 / GRAVITY)),
    "all gyroscopes by 0.5": gained(0.5),
    "rate of 50 Hz stated for 100": called(0.5),
    "rate of 200 Hz stated for 100": called(2.0),
    "accelerometer 50 ms late": signal("acc", late(0.05)),
    "accelerometer 100 ms late": signal("acc", late(0.1)),
    "gyroscope 100 ms late": signal("gyr", late(0.1)),
    "sensor 0.1 s late": signal("gyr acc", late(0.1)),
    "sensor 0.3 s late": signal("gyr acc", late(0.3)),
    "sensor's clock 1 % fast": signal("gyr acc", late(0.0, 0.01)),
    "every second row repeated": signal("gyr acc", repeated),
    "25 Hz": every(4),
    "50 Hz": every(2),
}
"""What is wrong → the damage. Values are in the file's units, deg/s and m/s²."""

FAULTS: dict[str, Damage] = {
    "all gyroscopes by 1.07": gained(1.07),
    "all gyroscopes drift to 1.15": gained(1.0, 1.15),
    "gyroscope by 1.07": signal("gyr", times(1.07)),
    "rate stated 3 % too high": called(1.03),
    "rate stated 3 % too low": called(0.97),
    "rate stated 10 % too high": called(1.1),
    "rate of 100 Hz stated for 128": called(100.0 / 128.0),
    "four cells of -9999, gyr": cells("gyr", -9999.0, 4),
    "an axis of the gyroscope stuck for 2 s": stuck(2.0),
    "stamps of a timer of 1/64 s": stamps(lambda t, *_: np.floor(t * 64.0) / 64.0),
    "packets of five rows share a stamp": stamps(
        lambda t, *_: t[np.minimum(np.arange(t.size) // 5 * 5 + 4, t.size - 1)]
    ),
    "called foot, or shank": called_on("foot", "shank"),
    "called thigh, or lower back": called_on("thigh", "lower_back"),
}
"""What a laboratory states wrongly, and what wears out slowly."""

MISUSE = DAMAGES | FAULTS
"""All that is done to walks."""
