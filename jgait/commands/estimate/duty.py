"""What `jgait estimate` does with gyroscopes that sleep: angles, rates as measured and filled, and what is saved."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from jgait.commands.console import note, stop
from jgait.commands.estimate.legs import Show, table_of
from jgait.duty_cycle.fillers.base import FILLED, HELD, MEASURED
from jgait.estimators import Estimator
from jgait.types import SIDES, Estimate, Recording, as_float

WORDS = {MEASURED: "measured", FILLED: "filled", HELD: "held"}
UNITS = 10
"""Most units of a schedule's period."""

SHOWN_S = 15.0
"""[s] How much of a long recording the figure shows, from a little before the first gap."""


def options_of(duty: float | None, filler: str | None, warm_up: float | None, paper: bool) -> Any:
    """The options of `duty_cycled_gyro`; leaves with 2 for a duty cycle or a filler that there is not."""
    from jgait.duty_cycle.recording import check_filler, schedule_of
    from jgait.estimators import duty_cycled_gyro

    if duty is not None and 0.0 < duty <= 1.0:
        near = Fraction(duty).limit_denominator(UNITS)
        near = max(near, Fraction(1, UNITS))
        if abs(float(near) - duty) > 1e-6:
            note(f"--duty {duty:g} is taken as {near} of the time: on and off last whole units of 1.4 s")
        duty = float(near)
    options = duty_cycled_gyro.PAPER if paper else duty_cycled_gyro.DEFAULT
    options = options._replace(
        schedule=duty, filler=filler or options.filler, warm_up=options.warm_up if warm_up is None else warm_up
    )
    try:
        schedule_of(options.schedule, options.gyroscope)
        check_filler(options.filler)
    except ValueError as error:
        stop(str(error))
    return options


def pipeline(options: Any) -> Estimator[Any, Any]:
    """The estimator with these options, whose parameters are those of their filler."""
    from jgait.estimators import duty_cycled_gyro

    return duty_cycled_gyro.estimator(options)


def gyroscopes(params: Any, options: Any, thigh: float | None, shank: float | None) -> Show:
    """How sleeping gyroscopes are estimated and shown.

    Args:
        params: to start from.
        options: from `options_of`.
        thigh: the person's own length [m], or None.
        shank: the same.
    """
    from jgait.estimators import duty_cycled_gyro

    known = {"thigh_length": thigh, "shank_length": shank}
    p = duty_cycled_gyro.with_body(params, {name: value for name, value in known.items() if value is not None})
    if options.schedule is None:
        note("no --duty: gyroscopes sleep only where the file has no samples")

    def run(recording: Recording) -> Estimate:
        return duty_cycled_gyro.estimate(p, recording, options)

    angles = tuple(f"{joint} {side}\n[°]" for side in SIDES for joint in ("hip", "knee"))
    columns = ("recording", "measured\n[%]", "held\n[%]", "saved\n[%]", "life\n[×]", *angles)
    caption = (
        f"gaps filled by {options.filler}; held: too little was measured before to fill from; saved: of the energy of "
        "the gyroscopes; life: of a battery that feeds all sensors, over always on; angles: smallest … largest flexion"
    )
    return Show(run, _write, _rows, table_of("duty_cycled_gyro", columns), caption, totals)


def worn(result: Estimate) -> list[str]:
    """Placements that the estimate tells of."""
    names = [f"{segment}_{side}" for side in SIDES for segment in ("thigh", "shank")]
    return [name for name in names if f"how_{name}" in result.diagnostics]


def segment_table(result: Estimate) -> Any:
    """A row a sample: of each sensor the angle with its deviation, the rate that was used and how it was had."""
    import pandas as pd

    told = result.diagnostics
    columns: dict[str, Any] = {"time_s": as_float(result.time)}
    for name in worn(result):
        columns |= {
            f"{name}_angle_deg": np.degrees(as_float(told[f"angle_{name}"])),
            f"{name}_angle_std_deg": np.degrees(as_float(told[f"angle_stddev_{name}"])),
            f"{name}_gyr_deg_s": np.degrees(as_float(told[f"gyro_{name}"])),
            f"{name}_gyr_is": [WORDS[int(how)] for how in told[f"how_{name}"]],
        }
    return pd.DataFrame(columns)


def totals(result: Estimate) -> dict[str, Any]:
    """What the whole recording comes to, for the JSON file."""
    told = result.diagnostics
    how = {name: np.asarray(told[f"how_{name}"]) for name in worn(result)}
    return {
        "gyroscope_measured": float(told["usable_share"]),
        "gyroscope_energy_saved": float(told["gyro_energy_saved"]),
        "mean_power_w": float(told["mean_power"]),
        "battery_h_per_wh": float(told["battery_life"]) / 3600.0,
        "battery_always_on_h_per_wh": float(told["battery_life_always_on"]) / 3600.0,
        "latency_s": float(told["latency"]),
        "samples": {
            name: {word: int(np.sum(kinds == kind)) for kind, word in WORDS.items()} for name, kinds in how.items()
        },
    }


def shown(result: Estimate) -> tuple[float, float] | None:
    """From and to [s] that the figure shows; None: all of it."""
    time = as_float(result.time)
    if time[-1] - time[0] <= 2.0 * SHOWN_S:
        return None
    asleep = np.any([np.asarray(result.diagnostics[f"how_{name}"]) == FILLED for name in worn(result)], axis=0)
    start = float(max(time[0], time[int(np.argmax(asleep))] - 0.2 * SHOWN_S))
    return start, start + SHOWN_S


def _write(result: Estimate, out: Path, name: str) -> list[Path]:
    from jgait import io, plot

    files = [io.write_csv(segment_table(result), out / f"{name}_segments.csv")]
    if any(leg is not None for leg in result.legs):
        files.append(io.write_csv(result, out / f"{name}_legs.csv"))
    figure = plot.sleeping_gyroscopes(result, seconds=shown(result), title=name)
    return [*files, plot.save(figure, out / f"{name}_gyroscopes.png")]


def _rows(result: Estimate, name: str) -> list[list[str]]:
    told = totals(result)
    held = [kinds["held"] / sum(kinds.values()) for kinds in told["samples"].values()]
    shares = (told["gyroscope_measured"], np.mean(held), told["gyroscope_energy_saved"])
    life = told["battery_h_per_wh"] / told["battery_always_on_h_per_wh"]
    cells = [*(f"{100.0 * share:.0f}" for share in shares), f"{life:.2f}"]
    for leg in result.legs:
        for values in (None, None) if leg is None else (leg.hip_angle, leg.knee_angle):
            low, high = ("", "") if values is None else np.degrees([np.min(values), np.max(values)])
            cells.append("–" if values is None else f"{low:.0f} … {high:.0f}")
    return [[name, *cells]]
