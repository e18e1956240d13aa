"""The `About` record of `duty_cycled_gyro`."""

from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import PyTree

from jgait.duty_cycle.filling import FILLED, HELD, MEASURED
from jgait.duty_cycle.power import GYROSCOPE, MOST_UNITS
from jgait.duty_cycle.recording import check_filler, schedule_of
from jgait.estimators.about import About, CommandOption, EstimateFigure, EstimateTable, Settings
from jgait.estimators.duty_cycled_gyro.params import DEFAULT, PAPER
from jgait.estimators.totals import HEIGHT, NO_LENGTHS, SHANK, THIGH, has_legs
from jgait.types import SIDES, Estimate, as_float

WORDS = {MEASURED: "measured", FILLED: "filled", HELD: "held"}

SHOWN_S = 15.0
"""[s] Time that the figure of a long recording shows, from shortly before the first gap."""


def worn(estimate: Estimate) -> list[str]:
    """Placements of the sensors of an estimate."""
    names = [f"{segment}_{side}" for side in SIDES for segment in ("thigh", "shank")]
    return [name for name in names if f"how_{name}" in estimate.diagnostics]


def segments(estimate: Estimate) -> dict[str, Any]:
    """Columns (T,): angle of each sensor with standard deviation, rate, and source of the rate."""
    diagnostics = estimate.diagnostics
    columns: dict[str, Any] = {"time_s": as_float(estimate.time)}
    for name in worn(estimate):
        columns |= {
            f"{name}_angle_deg": np.degrees(as_float(diagnostics[f"angle_{name}"])),
            f"{name}_angle_std_deg": np.degrees(as_float(diagnostics[f"angle_stddev_{name}"])),
            f"{name}_gyr_deg_s": np.degrees(as_float(diagnostics[f"gyro_{name}"])),
            f"{name}_gyr_is": [WORDS[int(how)] for how in diagnostics[f"how_{name}"]],
        }
    return columns


def numbers(estimate: Estimate) -> dict[str, Any]:
    """Totals of a recording for the JSON file."""
    diagnostics = estimate.diagnostics
    how = {name: np.asarray(diagnostics[f"how_{name}"]) for name in worn(estimate)}
    return {
        "gyroscope_measured": float(diagnostics["usable_share"]),
        "gyroscope_energy_saved": float(diagnostics["gyro_energy_saved"]),
        "mean_power_w": float(diagnostics["mean_power"]),
        "battery_h_per_wh": float(diagnostics["battery_life"]) / 3600.0,
        "battery_always_on_h_per_wh": float(diagnostics["battery_life_always_on"]) / 3600.0,
        "latency_s": float(diagnostics["latency"]),
        "samples": {
            name: {word: int(np.sum(kinds == kind)) for kind, word in WORDS.items()} for name, kinds in how.items()
        },
    }


def _facts(estimate: Estimate) -> list[tuple[str, str]]:
    known = numbers(estimate)
    held = float(np.mean([kinds["held"] / sum(kinds.values()) for kinds in known["samples"].values()]))
    shares = {
        "measured": known["gyroscope_measured"], "held": held, "energy saved": known["gyroscope_energy_saved"]
    }  # fmt: skip
    life = known["battery_h_per_wh"] / known["battery_always_on_h_per_wh"]
    return [*((words, f"{100.0 * share:.0f} %") for words, share in shares.items()), ("battery life", f"× {life:.2f}")]


def shown(estimate: Estimate) -> tuple[float, float] | None:
    """Start and end of the figure [s]; None: the whole recording."""
    time = as_float(estimate.time)
    if time[-1] - time[0] <= 2.0 * SHOWN_S:
        return None
    asleep = np.any([np.asarray(estimate.diagnostics[f"how_{name}"]) == FILLED for name in worn(estimate)], axis=0)
    start = float(max(time[0], time[int(np.argmax(asleep))] - 0.2 * SHOWN_S))
    return start, start + SHOWN_S


def nearest_duty(duty: float) -> float:
    """The nearest duty cycle with a denominator of at most `MOST_UNITS`. Raises ValueError for a duty cycle outside
    (0, 1], or one that the gyroscope cannot follow.
    """
    if 0.0 < duty <= 1.0:
        duty = float(max(Fraction(duty).limit_denominator(MOST_UNITS), Fraction(1, MOST_UNITS)))
    schedule_of(duty, GYROSCOPE)
    return duty


def _remark(duty: float | None) -> str:
    if duty is None:
        return "no --duty: gyroscopes sleep only where the file has no samples"
    near = nearest_duty(duty)
    if abs(near - duty) < 1e-6:
        return ""
    share = Fraction(near).limit_denominator(MOST_UNITS)
    return f"--duty {duty:g} is taken as {share} of the time: on and off last whole units of 1.4 s"


def _option(settings: Settings, **changed: PyTree) -> Settings:
    return {**settings, "options": settings["options"]._replace(**changed)}


ABOUT = About(
    title="Hip and knee angles from sensors whose gyroscopes sleep part of the time",
    needs="the columns of leg_ekf, or those of one segment alone.",
    source="Udaya Shankar et al. 2010",
    default=DEFAULT,
    paper=PAPER,
    measures=(THIGH, SHANK, HEIGHT),
    missing=(NO_LENGTHS._replace(text="the default length of 0.43 m is taken"),),
    options=(
        CommandOption(
            "--duty", "part of the time that the shank's gyroscope is on, in tenths, 0.1 to 1; the other samples are "
            "hidden as if the gyroscope slept.", parse=nearest_duty, remark=_remark,
            settings=lambda settings, value: _option(settings, schedule=value),
        ),
        CommandOption(
            "--filler", "how gaps are filled, such as neighbours or replicate; a wrong name lists all.", str,
            parse=lambda name: check_filler(name) and name,
            settings=lambda settings, value: _option(settings, filler=value),
        ),
        CommandOption(
            "--warm-up", "how long all gyroscopes are on at first [s]; 0.", low=0.0,
            settings=lambda settings, value: _option(settings, warm_up=value),
        ),
    ),
    facts=_facts,
    caption=(
        "gaps filled by {options.filler}; held: too few samples, or none alike, were measured before to fill from; "
        "energy saved: of the gyroscopes; battery life: of one that feeds all sensors, over always on"
    ),
    tables=(EstimateTable("segments", segments), EstimateTable("legs", "samples", when=has_legs)),
    figures=(
        EstimateFigure(
            "sleeping_gyroscopes", "gyroscopes",
            arguments=lambda made: ((made.estimate,), {"seconds": shown(made.estimate)}),
            caption="Angles, and the rate of each gyroscope as measured and as filled; grey where it sleeps.",
        ),
    ),
    numbers=numbers,
    losses=("trajectory", "joint_angles", "foot_path", "likelihood", "calibration"),
)  # fmt: skip
"""Measures, options, tables and figures, for commands and reports."""
