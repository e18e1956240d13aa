"""Shoes whose sampling rate is stated wrongly: how many are noted, by how wrong the rate is.

The limit `OFF_FROM` was chosen on these public sets, so that none of them as measured is noted.
"""

import numpy as np

from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from jgait.estimators import foot_ins
from jgait.quality import SensorQuality
from jgait.types import Recording, as_float

SETS = ("walking5m", "neura_sparse", "tripod", "gaitmap_example", "pyshoe_vicon", "footprints")
"""Public sets with sensors on shoes."""

CLOCKS = {"as measured": 1.0, "10 % too high": 1.1, "100 Hz for 128": 100.0 / 128.0, "half": 0.5, "twice": 2.0}
"""How the rate is stated, and its factor."""


def stated(recording: Recording, factor: float) -> Recording:
    """The shoes of a recording, with a sampling rate that is too high by a factor."""
    feet = {
        name: imu._replace(time=as_float(imu.time) / factor)
        for name, imu in recording.sensors.items() if name.startswith("foot")
    }  # fmt: skip
    return recording._replace(sensors=feet, sampling_rate_hz=recording.sampling_rate_hz * factor)


def qualities(recording: Recording, factor: float) -> dict[str, SensorQuality]:
    """Facts about the shoes' sensors; nothing where the recording is refused."""
    label = f"{recording.name}, rate by {factor:.3g}"
    made = attempt(label, lambda: foot_ins.estimator().prepare(stated(recording, factor)))
    return {} if made is None else dict(made.quality)


def rows(quick: bool) -> list[Row]:
    """The share of shoes that are noted, among those with a known scale as measured."""
    sets = [name for name in SETS if available(name)]
    recordings = [
        walk.recording for name in (sets[:1] if quick else sets) for walk in walks(name, names(name))
        if any(sensor.startswith("foot") for sensor in walk.recording.sensors)
    ]  # fmt: skip
    noted: dict[str, list[bool]] = {how: [] for how in CLOCKS}
    for recording in recordings:
        known = [name for name, sensor in qualities(recording, 1.0).items() if sensor.rates_factor != 1.0]
        for how, factor in CLOCKS.items():
            facts = qualities(recording, factor)
            noted[how] += [facts[name].rates_off for name in known if name in facts]
    shares = {how: 100.0 * float(np.mean(flags)) for how, flags in noted.items() if flags}
    show(
        "Shoes with a wrong sampling rate",
        ["rate", "noted", "of"],
        [[how, sum(flags), len(flags)] for how, flags in noted.items()],
    )
    return [
        Row(f"rate_noted_pct_{how.replace(' % ', '_').replace(' ', '_')}", share, "%", n=len(noted[how]),
            split="sets on which the limit was chosen").on("shoes with a wrong sampling rate, noted", how, "shoes")
        for how, share in shares.items()
    ]  # fmt: skip
