"""`jgait report`: one HTML page about a recording or a cohort."""

import importlib
import shlex
import sys
import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer

from jgait.commands import cohort as cohorts
from jgait.commands import recordings
from jgait.commands.cohort import LENGTHS
from jgait.commands.console import Bar, console, count, in_options, note, progress, say_failures, stop
from jgait.commands.pipeline import measures_of, pipeline_of, refuse_others, start_of
from jgait.types import Estimate, Recording

ENDINGS = (".html", ".htm")
"""What a page's name may end with."""


def report(
    what: Annotated[
        Path | None,
        typer.Argument(
            metavar="[WALK.csv|COHORT.csv|FOLDER]",
            help="A recording, a table of recordings with a column `file`, or the folder that jgait evaluate wrote.",
        ),
    ] = None,
    dataset: cohorts.Dataset = None,
    simulated: cohorts.Simulated = None,
    recording: Annotated[
        str | None, typer.Option(help="Of --dataset this recording alone, with its reference in the figures.")
    ] = None,
    estimator: cohorts.EstimatorName = "leg_ekf",
    paper: cohorts.Paper = False,
    params: cohorts.Params = None,
    thigh: Annotated[float | None, typer.Option(min=0.2, max=0.7, help="leg_ekf: thigh length [m]; 0.43.")] = None,
    shank: Annotated[float | None, typer.Option(min=0.2, max=0.7, help="leg_ekf: shank length [m]; 0.43.")] = None,
    scale: Annotated[float | None, typer.Option(min=0.1, help="leg_ekf: personal scale of the distance; 1.")] = None,
    pivot: Annotated[
        float | None, typer.Option(min=0.0, max=0.3, help="foot_ins: height of the sensor over the ball [m]; 0.08.")
    ] = None,
    range_offset: Annotated[
        float | None, typer.Option(min=-0.2, max=0.4, help="stride_width_ekf: feet farther apart than the range [m].")
    ] = None,
    lever: Annotated[
        float | None, typer.Option(min=-0.05, max=0.2, help="ankle_stride: height over the ankle [m]; 0.03, or 0.18.")
    ] = None,
    height: Annotated[float | None, typer.Option(min=0.8, max=2.4, help="waist_ofdri: of the person [m].")] = None,
    sensor_height: Annotated[
        float | None, typer.Option(min=0.4, max=1.6, help="waist_ofdri: of the sensor above the ground [m]; 0.97.")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Samples a second [Hz]; needed without a time column.")] = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    range_unit: Annotated[str, typer.Option(help="Of the column feet_range: m, cm or mm.")] = "m",
    format: recordings.Format = None,
    place: recordings.Place = None,
    trial: recordings.Trial = None,
    seed: cohorts.Seed = 0,
    out: Annotated[Path, typer.Option(help="The page.")] = Path("report.html"),
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the numbers here.")] = None,
) -> None:
    """One self-contained HTML page about a recording or a cohort: summary, doubts in plain words, figures, tables.

    The page asks for nothing from outside, and names no folder. Leaves with 0 if all went well, 1 if some recordings
    of a cohort could not be used, 2 if nothing could be done.
    """
    if out.suffix.lower() not in ENDINGS:
        stop(f"--out is the name of a page and ends with .html; got {out.name!r}")
    of_one = {
        "--thigh": thigh, "--shank": shank, "--scale": scale, "--pivot": pivot, "--range-offset": range_offset,
        "--lever": lever, "--height": height, "--sensor-height": sensor_height,
    }  # fmt: skip
    placement, placements = recordings.places_of(place)
    files = {"rate": rate, "gyr_unit": gyr_unit, "acc_unit": acc_unit, "range_unit": range_unit, "format": format,
             "placement": placement, "placements": placements, "trial": trial}  # fmt: skip
    command = command_of(sys.argv if Path(sys.argv[0]).stem == "jgait" else ["jgait", "report"])
    failures: list[tuple[str, str]] = []
    if recording is not None and dataset is None:
        stop("--recording names a recording of a --dataset; there is none")
    if what is not None and dataset is None and simulated is None and what.is_dir():
        page, failures = _of_folder(what, command)
    elif recording is not None or (what is not None and not (dataset or simulated) and not is_cohort(what)):
        page = _of_one(what, dataset, recording, estimator, paper, params, of_one, files, command)
    else:
        given = [name for name, value in of_one.items() if value is not None]
        if given:
            stop(f"{given[0]} is of one recording; for a cohort put a column into its table")
        page, failures = _of_cohort(what, dataset, simulated, seed, estimator, paper, params, files, command)
    _write(page, out, json_file)
    if show:
        webbrowser.open(out.resolve().as_uri())
    if failures:
        console.print(f"{count(len(failures), 'recording', 'recordings')} could not be used", highlight=False)
        raise typer.Exit(1)


def command_of(words: list[str]) -> str:
    """A command as it may be shown to others: files by their names alone.

    Args:
        words: of the command line, the program first.
    """
    shown = ["jgait", *(_by_name(word) for word in words[1:] if word != "--open")]
    return shlex.join(shown)


def _by_name(word: str) -> str:
    option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    return option + equals + (Path(value).name if "/" in value or "\\" in value else value)


def is_cohort(path: Path) -> bool:
    """Whether a table has a column `file`; what cannot be read is left to who reads it."""
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            header = stream.readline(100_000)
    except OSError:
        return False
    for separator in ",;\t":
        header = header.replace(separator, "\n")
    return "file" in (name.strip().strip('"').lower() for name in header.splitlines())


def _of_one(
    file: Path | None, dataset: str | None, name: str | None, estimator: str, paper: bool, params: Path | None,
    measures: dict[str, Any], files: dict[str, Any], command: str,
) -> Any:  # fmt: skip
    """The page of one recording, of a file or of a data set; leaves with 2 where it cannot be used."""
    from jgait import datasets
    from jgait import report as reports
    from jgait.params import check_params

    pipeline = pipeline_of(estimator, paper)
    refuse_others(estimator, measures)
    start = start_of(pipeline, params, paper)
    reference, known = None, {}
    try:
        if dataset is not None:
            if file is not None:
                stop("give one of: a file, --dataset NAME; got both")
            found = datasets.load(dataset, only=(str(name),))
            if not found:
                stop(found.failures[0].reason if found.failures else f"{dataset} has no recording {name!r}")
            walked, reference = found[0].recording, found[0].reference
            known = cohorts.body(found[0], measures_of(pipeline))
        else:
            walked = recordings.recording_of(Path(str(file)), **files)
    except (datasets.DatasetUnavailable, ValueError, OSError) as error:
        stop(f"{file or dataset}: {in_options(str(error))}")
    p, missing = own_params(pipeline, start, {**known, **body_of(estimator, measures)}, measures, params is not None)
    for line in missing:
        note(line)
    try:
        check_params(p, pipeline.transforms)
        result = _estimated(estimator, p, walked, paper, measures)
    except (ValueError, OSError) as error:
        stop(f"{file or name}: {error}")
    for line in result.diagnostics["notes"]:
        note(line)
    made = reports.Made(
        estimator, p, pipeline.params, "the paper's" if paper else "", str(file or f"{dataset}: {name}"), command,
        tuple(missing),
    )  # fmt: skip
    return reports.of_estimate(result, walked, reference=reference, made=made)


def body_of(estimator: str, given: dict[str, Any]) -> dict[str, Any]:
    """A person's measures by the names that the estimator knows, of options that were given."""
    legs = {"thigh_length": "--thigh", "shank_length": "--shank"}
    names = {
        "leg_ekf": legs,
        "duty_cycled_gyro": legs,
        "foot_ins": {"pivot_height": "--pivot"},
        "stride_width_ekf": {"range_offset": "--range-offset"},
        "ankle_stride": {"lever_ankle": "--lever", "lever_shank": "--lever"},
        "waist_ofdri": {"height": "--height", "sensor_height": "--sensor-height"},
    }
    found = {name: given[option] for name, option in names.get(estimator, {}).items()}
    return {name: value for name, value in found.items() if value is not None}


def own_params(
    pipeline: Any, start: Any, body: dict[str, Any], given: dict[str, Any], told: bool
) -> tuple[Any, list[str]]:
    """The parameters of one person, and in words what was not given.

    Args:
        pipeline: the estimator.
        start: its parameters to start from.
        body: the person's measures.
        given: option → value or None.
        told: whether the parameters are someone's own, so that nothing is missing.
    """
    from jgait.commands.estimate.strides import TAPE_SD

    p = pipeline.own(start, body)
    if given["--scale"] is not None:
        p = p._replace(distance_scale=given["--scale"])
    if given["--lever"] is not None:
        p = p._replace(lever_along_sd=min(TAPE_SD, float(p.lever_along_sd)))
    if told:
        return p, []
    asked = {
        "leg_ekf": LENGTHS, "duty_cycled_gyro": LENGTHS, "stride_width_ekf": ("range_offset",),
        "ankle_stride": ("lever_ankle",), "waist_ofdri": ("height", "sensor_height"),
    }  # fmt: skip
    lacking = [name for name in asked.get(pipeline.name, ()) if name not in body]
    if not lacking or (pipeline.name == "waist_ofdri" and len(lacking) < 2):
        return p, []
    words = " or ".join(name.replace("_", " ") for name in lacking)
    return p, [f"no {words} was given: the default of the estimator stands in for it"]


def _estimated(estimator: str, p: Any, walked: Recording, paper: bool, given: dict[str, Any]) -> Estimate:
    from jgait.estimators import foot_ins

    module = importlib.import_module(f"jgait.estimators.{estimator}")
    options = (module.PAPER,) if paper else ()
    more = {}
    if estimator == "stride_width_ekf" and given["--pivot"] is not None:
        more["foot_params"] = foot_ins.with_body(foot_ins.FootParams(), {"pivot_height": given["--pivot"]})
    result: Estimate = module.estimate(p, walked, *options, **more)
    return result


def _of_cohort(
    table: Path | None, dataset: str | None, simulated: int | None, seed: int, estimator: str, paper: bool,
    params: Path | None, files: dict[str, Any], command: str,
) -> tuple[Any, list[tuple[str, str]]]:  # fmt: skip
    """The page of a cohort that is computed now."""
    import functools

    from jgait import evaluate as evaluation
    from jgait import report as reports

    pipeline = pipeline_of(estimator, paper)
    start = start_of(pipeline, params, paper)
    measures = measures_of(pipeline)
    source = cohorts.source(table, dataset, simulated, seed, files["gyr_unit"], files["acc_unit"], measures)
    for line in source.notes:
        note(line)
    own = functools.partial(cohorts.body, measures=measures)
    with progress() as bars:
        bar, total = Bar(bars), len(source.items)
        bar("reading and computing", 0, total)
        try:
            found = evaluation.cohort(
                pipeline, source.items, start, own=own, read=source.read,
                progress=lambda done, failed: bar(f"{done} recordings, {failed} of them failed", done, total),
            )  # fmt: skip
        except (ValueError, OSError) as error:
            stop(str(error))
    failures = source.failures + list(zip(found.failures["recording"], found.failures["reason"], strict=True))
    say_failures(failures)
    if not len(found.recordings):
        stop(f"none of the {len(failures)} recordings of {source.title} could be used")
    made = reports.Made(
        pipeline.name, start, pipeline.params, "the paper's" if paper else "", source.title, command,
        tuple(source.notes),
    )  # fmt: skip
    return reports.of_cohort(found, title=source.title, failures=failures, made=made), failures


def _of_folder(folder: Path, command: str) -> tuple[Any, list[tuple[str, str]]]:
    """The page of what `jgait evaluate` left in a folder."""
    from jgait import report as reports
    from jgait.report import folder as folders

    try:
        found, failures = folders.read(folder)
        made = folders.made(folder)._replace(command=command)
        return reports.of_cohort(found, title=folder.resolve().name, failures=failures, made=made), failures
    except (ValueError, OSError) as error:
        stop(f"{folder} is no folder that jgait evaluate wrote: {error}")


def _write(page: Any, out: Path, json_file: Path | None) -> None:
    """The page, and the numbers where they are asked for; leaves with 2 where they cannot be written."""
    written = [(page.save, out)] + ([(page.save_numbers, json_file)] if json_file is not None else [])
    for save, path in written:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            save(path)
        except OSError as error:
            stop(f"{path} could not be written: {error}")
    console.print("wrote " + ", ".join(str(path) for _, path in written), soft_wrap=True, highlight=False)
