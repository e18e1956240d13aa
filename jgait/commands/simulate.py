"""`jgait simulate`: walks with known truth, as the files that a lab would record."""

import contextlib
from pathlib import Path
from typing import Annotated, Any

import jax
import numpy as np
import pandas as pd
import typer

from jgait import io
from jgait import simulate as simulation
from jgait.commands.console import Bar, count, progress, refused, say, show, stop, write_json
from jgait.commands.folder import results_folder
from jgait.simulate import GAITS
from jgait.simulate import sensors as worn_sensors
from jgait.simulate.routes import Route, walked_length
from jgait.types import PLACEMENTS, Recording

ROUTES = {"straight": 1, "u_turn": 1, "about_turn": 1, "rectangle": 2, "circle": 1}
"""Name → the number of lengths [m] of the route."""


def simulate(
    people: Annotated[int, typer.Option(min=1, help="Number of people, drawn from published norms.")] = 1,
    route: Annotated[
        str,
        typer.Option(
            help="straight:20, u_turn:8 (half a circle), about_turn:8 (on the spot), rectangle:10,5, circle:4; metres."
        ),
    ] = "straight:20",
    gait: Annotated[str | None, typer.Option(help=f"A gait that is not the usual one: {', '.join(GAITS)}.")] = None,
    sensors: Annotated[
        str | None, typer.Option(help="Such as ideal, mpu6000, opal (its range of 200 g), idg300; default mpu6000.")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Samples a second [Hz]; default 100.")] = None,
    placements: Annotated[
        str | None, typer.Option(help="Where sensors are worn, such as thigh_right,shank_right; default seven.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Random seed of people, their steps and the errors of the sensors.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("jgait-simulation"),
    fresh: Annotated[bool, typer.Option("--fresh", help="Delete the files of another simulation in the folder.")] = (
        False
    ),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the list of files here.")] = None,
) -> None:
    """Simulate walks of people with worn sensors: recordings, their exact truth, and a table of them all.

    Writes NAME.csv (the signals), NAME_truth.csv (angles, paths of ankles and of sensors on feet, distance),
    NAME_strides.csv, and cohort.csv, which `jgait evaluate` and `jgait tune` take. The same options give the same
    files; names of people end with the seed if it is not 0. Feet, pelvis and sensors move as those of recorded people
    do.
    """
    worn = simulation.SEVEN if placements is None else tuple(filter(None, map(str.strip, placements.split(","))))
    asked: dict[str, Any] = {
        "people": people, "route": route, "gait": gait, "sensors": sensors, "rate": rate,
        "placements": placements and list(worn), "seed": seed,
    }  # fmt: skip
    if gait is not None and gait not in GAITS:
        stop(f"--gait must be one of {', '.join(GAITS)}; got {gait!r}")
    if rate is not None and not 10.0 <= rate <= 1000.0:
        stop(f"--rate must be between 10 and 1000 Hz; got {rate:g}")
    for name in worn:
        if name not in PLACEMENTS:
            stop(f"--placements: there is no {name!r}; known are {', '.join(PLACEMENTS)}")
    along, errors = _route(route), sensor_of(sensors or "mpu6000")
    who, how = jax.random.split(jax.random.key(seed))
    drawn = simulation.population(who, people)
    keys = [jax.random.fold_in(how, i) for i in range(people)]
    persons = [simulation.person_of(drawn, i) for i in range(people)]
    persons = [person if gait is None else simulation.walking(person, gait) for person in persons]
    names = [f"subject_{i + 1:04d}{f'_seed{seed}' if seed else ''}" for i in range(people)]  # of two seeds are others
    distance = float(walked_length(along))
    written: dict[str, Any] = {}
    with (
        results_folder(out, "simulate", asked, planned=["cohort.csv"], json_file=json_file, fresh=fresh) as folder,
        progress() as bars,
        refused(),
    ):
        bar, files = Bar(bars), list[Path]()
        bar("simulating (the first walk compiles)", 0, people)
        persons = [simulation.covering(key, person, along) for key, person in zip(keys, persons, strict=True)]
        walks = simulation.walks(keys, persons, [along] * people, errors, rate or 100.0, worn, names=names)
        for person, (recording, truth) in zip(persons, walks, strict=True):
            written[recording.name] = _written(recording, truth, person, distance, folder.stage, files)
            bar("simulating", len(written), people)
        table = pd.DataFrame(list(written.values())).drop(columns=["duration_s", "strides", "sensors"])
        folder.publish([*files, io.write_csv(table, folder.stage / "cohort.csv")])
    write_json(json_file, {"asked": asked, "walks": written})
    rows = [
        (name, f"{row['duration_s']:.1f}", f"{row['distance_m']:.2f}", row["strides"], len(row["sensors"]))
        for name, row in list(written.items())[:20]
    ]
    show("recording", "duration [s]", "distance [m]", "strides", "sensors", rows=rows, title="simulated walks")
    if len(written) > 20:
        say(f"… and {len(written) - 20} more")
    cohort = out / "cohort.csv"
    many = count(len(written), "recording", "recordings")
    say(f"wrote {many}, each with its truth, and {cohort} (jgait evaluate {cohort})")


def sensor_of(name: str) -> worn_sensors.ImuErrors:
    """The errors of a sensor by its name, in any case; exits with code 2 for an unknown name."""
    known = {name.lower(): errors for name, errors in vars(worn_sensors).items()
             if isinstance(errors, worn_sensors.ImuErrors)}  # fmt: skip
    if name.lower() not in known:
        stop(f"--sensors must be one of {', '.join(sorted(known))}; got {name!r}")
    return known[name.lower()]


def _route(text: str) -> Route:
    """The route of a text; exits with code 2 for a text that is no route."""
    name, _, lengths = text.partition(":")
    expected = "--route is straight:LENGTH, u_turn:LENGTH, about_turn:LENGTH, rectangle:A,B or circle:RADIUS in metres"
    if name not in ROUTES:
        stop(f"{expected}; got {text!r}")
    with contextlib.suppress(ValueError):
        metres = [float(text) for text in lengths.split(",")]
        if len(metres) == ROUTES[name] and all(1.0 <= metre <= 1000.0 for metre in metres):
            return getattr(simulation, name)(*metres)
    return stop(f"{expected}, from 1 to 1000 m; got {text!r}")


def _written(
    recording: Recording, truth: simulation.Truth, person: simulation.Person, distance: float, out: Path,
    files: list[Path],
) -> dict[str, Any]:  # fmt: skip
    """Write the files of a walk, and add them to the list; returns the numbers of the walk."""
    body, name = person.body, recording.name
    files += [
        io.write_csv(recording, out / f"{name}.csv"),
        io.write_csv(truth.estimate, out / f"{name}_truth.csv"),
        io.write_csv(io.strides_to_dataframe(truth.estimate), out / f"{name}_strides.csv"),
    ]
    parts = ("height", "thigh_length", "shank_length", "sensor_height")
    lengths = {f"{part}_m": float(getattr(body, part)) for part in parts}
    return {
        "file": f"{name}.csv", "subject": recording.subject, **lengths, "distance_m": distance,
        "sampling_rate_hz": float(recording.sampling_rate_hz), "reference_samples": f"{name}_truth.csv",
        "reference_strides": f"{name}_strides.csv", "duration_s": float(truth.estimate.time[-1]),
        "strides": int(np.count_nonzero(truth.strides.valid)), "sensors": list(recording.sensors),
    }  # fmt: skip
