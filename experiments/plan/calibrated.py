"""`calibrate`: what it removes of planted errors of shoes' sensors, on simulated and on public walks.

Every sensor gets a scale and a bias of each axis, drawn with the deviations of `UNCALIBRATED`. The strides with the
errors, and with the errors after `calibrate`, are compared with those of the recording as it is: what calibration does
to a sensor without planted errors counts as an error too.
"""

import jax
import numpy as np

from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from experiments.plan.calibration import UNCALIBRATED, calibrate
from jgait import simulate
from jgait.estimators import foot_ins
from jgait.estimators.stride_flags import in_order, regular
from jgait.simulate.sensors import ON_SHOE
from jgait.tune.explain import with_error
from jgait.types import Recording, RecordingError

PUBLIC = {"pyshoe_vicon": 8, "footprints": 6, "gaitmap_example": 1, "walking5m": 8, "neura_sparse": 3}
"""Set with sensors on shoes → one walk of so many is taken."""

PEOPLE, METRES, MATCHED_S = 4, 30.0, 0.25


def lengths(recording: Recording) -> dict[tuple[int, float], float]:
    """Side and end [s] of each regular stride → its length [m]."""
    estimate = foot_ins.estimate(foot_ins.FootParams(), recording)
    rows = in_order(estimate)[regular(estimate, foot_ins.estimator().about.flags)]
    s = estimate.strides
    return {(int(s.side[k]), float(s.end[k])): float(s.length[k]) for k in rows}


def changes(before: dict[tuple[int, float], float], after: dict[tuple[int, float], float]) -> np.ndarray:
    """Change of the length of each stride that both have [m]."""
    made = []
    for (side, end), length in before.items():
        near = [(abs(end - at), value) for (other, at), value in after.items() if other == side]
        if near and min(near)[0] < MATCHED_S:
            made.append(min(near)[1] - length)
    return np.array(made)


def erring(recording: Recording, rng: np.random.Generator) -> Recording:
    """The recording with errors of every sensor."""
    for name in recording.sensors:
        for error in ("gyr_scale", "acc_scale", "gyr_bias", "acc_bias"):
            recording = with_error(recording, name, error, getattr(UNCALIBRATED, error) * rng.standard_normal(3))
    return recording


def of_walk(recording: Recording, rng: np.random.Generator) -> tuple[float, float, float]:
    """Root mean square change of strides by planted errors, before and after calibration, and by it alone [m]."""
    base, bad = lengths(recording), erring(recording, rng)
    if not base:
        raise RecordingError("no regular stride")
    made = (bad, calibrate(bad).applied(bad), calibrate(recording).applied(recording))
    planted, left, alone = (float(np.sqrt(np.mean(changes(base, lengths(one)) ** 2))) for one in made)
    return planted, left, alone


def rows(quick: bool) -> list[Row]:
    """The shares that are removed."""
    sensor = ON_SHOE._replace(gyr_scale=0.0, gyr_bias=0.0, gyr_drift=0.0, acc_scale=0.0, acc_bias=0.0)
    people, feet = 1 if quick else PEOPLE, ("foot_right", "foot_left")
    walked = simulate.cohort(jax.random.key(1), people, simulate.straight(METRES), sensor, 100.0, feet)
    sources = {"simulated": [recording for recording, _ in walked]}
    for name, every in {} if quick else PUBLIC.items():
        if available(name):
            sources[name] = [walk.recording for walk in walks(name, names(name)[::every])]
    rng, table = np.random.default_rng(0), []
    for name, recordings in sources.items():
        for recording in recordings:
            feet = {place: imu for place, imu in recording.sensors.items() if place.startswith("foot")}
            worn = recording._replace(sensors=feet, feet_range=None)
            made = attempt(f"{name} {recording.name}", lambda worn=worn: of_walk(worn, rng)) if feet else None
            if made is not None and np.isfinite(made).all():
                table.append([name, *(100.0 * value for value in made)])
    show(
        "change of a stride's length by errors of the sensors [cm]", ["set", "planted", "calibrated", "no error"], table
    )
    made_rows = []
    for public in (False, True):
        some = np.array([row[1:] for row in table if (row[0] != "simulated") == public])
        if len(some):
            planted, left, alone = np.sqrt(np.mean(some**2, axis=0))
            where = "public" if public else "simulated"
            line = "Sensors of shoes calibrated from a walk: share of planted errors' effect on strides that is removed"
            made_rows += [
                Row(f"calibration_share_{where}", 1.0 - left / planted, "1", n=len(some)).on(
                    line, where, "walks", simulated=not public),
                Row(f"calibration_alone_{where}", alone, "cm", n=len(some)).on(
                    line, f"{where}, no error", "walks", simulated=not public),
            ]  # fmt: skip
    return made_rows
