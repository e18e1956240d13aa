"""The `About` record of an estimator: measures of a person, options, tables, figures, flags.

Commands, reports and the documentation read this record, so that none of them lists the estimators by name. The
package of each estimator has its record in `about.py`.
"""

from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

from jaxtyping import PyTree

from jgait.notes import record
from jgait.types import Estimate, Recording

Settings = dict[str, Any]
"""Keyword arguments of a package's `estimator`: "options", and arguments that only this package has."""


class BodyMeasure(NamedTuple):
    """A measure of a person, or of the position of a sensor on the person, that `with_body` accepts."""

    name: str  #: name in `with_body`.
    unit: str  #: unit of the value.
    low: float  #: smallest value that is accepted.
    high: float  #: largest value that is accepted.
    meaning: str  #: description of the measure.
    option: str = ""  #: command-line option of the measure, or "".
    #: value that is used if the measure is missing, or None if stating it would be misleading.
    default: float | None = None
    parameter: str = ""  #: parameter that the measure sets; "" for the parameter of the same name.


class MissingMeasure(NamedTuple):
    """The note for missing measures, which are replaced by defaults."""

    measures: tuple[str, ...]
    text: str  #: consequence of the missing measure; a `str.format` template over the parameters `p`.
    any_one: bool = False  #: True if one of the measures is enough.


class CommandOption(NamedTuple):
    """A command-line option that only some estimators have."""

    name: str  #: name of the option, such as "--level".
    help: str  #: description of the option.
    kind: type = float  #: type of the value on the command line.
    low: float | None = None  #: smallest value, or None.
    high: float | None = None  #: largest value, or None.
    #: value of the command line → value that is used; raises ValueError for an invalid value.
    parse: Callable[[PyTree], PyTree] | None = None
    settings: Callable[[Settings, PyTree], Settings] | None = None  #: (settings, value) → settings.
    params: Callable[[PyTree, PyTree], PyTree] | None = None  #: (parameters, value) → parameters.
    #: value, or None if the option is not given → text of a note before the computation, or "".
    remark: Callable[[PyTree], str] | None = None


class EstimateTable(NamedTuple):
    """A table that is written to a file for a recording."""

    name: str  #: end of the file name.
    #: "samples": one row for each sample, see `jgait.io.to_dataframe`; "strides": one row for each stride, see
    #: `jgait.io.strides_to_dataframe`, with a column `special` for the flags; or a function that returns the columns or
    #: the rows. Names of columns end with their unit.
    rows: Literal["samples", "strides"] | Callable[[Estimate], PyTree]
    json: str = ""  #: key of the rows in the JSON file, or "" if the file does not contain them.
    when: Callable[[Estimate], bool] = lambda _: True  #: True for estimates that have the table.


class EstimatedRecording(NamedTuple):
    """An estimate, with the recording, parameters and settings from which it was computed."""

    recording: Recording
    estimate: Estimate
    params: PyTree
    settings: Settings


class EstimateFigure(NamedTuple):
    """A figure that is drawn for a recording."""

    plot: str  #: name of the function in `jgait.plot`.
    file: str  #: end of the file name.
    when: Callable[[Estimate], bool] = lambda _: True  #: True for estimates that have the figure.
    #: positional and keyword arguments of the function; the title is added.
    arguments: Callable[[EstimatedRecording], tuple[tuple[PyTree, ...], dict[str, PyTree]]] = (
        lambda made: ((made.estimate,), {})
    )  # fmt: skip
    caption: str = ""  #: caption in a report; a report contains only figures with a caption, and those of all estimates


class StrideFlag(NamedTuple):
    """A property of strides that are marked in tables, figures and reports."""

    name: str  #: name in `Estimate.diagnostics`.
    word: str  #: text of the flag in table files.
    label: str  #: text of the flag in figures and reports.
    meaning: str  #: effect of the property on the numbers, in a sentence.
    read: Callable[[Estimate], PyTree]  #: estimate → (strides,) bool, or None if the estimate does not contain the flag
    leaves_out: tuple[str, ...] = ()  #: columns of the table of strides in which flagged strides do not count in means.
    grade: str = "check"  #: severity, see `jgait.io.flags.GRADES`.


@record
class About(NamedTuple):
    """Description of an estimator for commands, reports and documentation."""

    title: str = "Gait from wearable sensors"  #: estimated quantities and sensors.
    needs: str = ""  #: columns of a recording that the estimator needs, in words.
    source: str = ""  #: authors and year of the method.
    default: object | None = None  #: options of the default pipeline.
    paper: object | None = None  #: options of the paper's pipeline, or None.
    measures: tuple[BodyMeasure, ...] = ()  #: measures of a person.
    missing: tuple[MissingMeasure, ...] = ()  #: notes for missing measures.
    options: tuple[CommandOption, ...] = ()  #: command-line options in addition to those of the measures.
    #: estimate → (words, value) of numbers that `jgait estimate` prints in addition to `io.Results.totals`.
    facts: Callable[[Estimate], list[tuple[str, str]]] = lambda _: []
    caption: str = ""  #: text below these; a `str.format` template over the settings.
    tables: tuple[EstimateTable, ...] = (EstimateTable("samples", "samples"),)  #: tables that are written to files.
    figures: tuple[EstimateFigure, ...] = ()  #: figures that are drawn.
    flags: tuple[StrideFlag, ...] = ()  #: flags of strides.
    #: estimate → JSON numbers in addition to those of every estimate.
    numbers: Callable[[Estimate], Mapping[str, PyTree]] = lambda _: {}
    #: names of the losses that the estimates can answer, see `jgait.tune.LOSSES`; None: not stated.
    losses: tuple[str, ...] | None = None
