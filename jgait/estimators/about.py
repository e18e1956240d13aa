"""What an estimator states about itself, as data: measures of a person, options, totals, tables, figures, flags.

Commands, reports and the documentation read this record, so that none of them lists the estimators by name. Each
estimator has its record in its own `about.py`.
"""

from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

from jaxtyping import PyTree

from jgait.notes import Note
from jgait.types import Estimate, Recording

Settings = dict[str, Any]
"""Keyword arguments of a package's `estimator`: its "options", and further ones that only this package has."""


class BodyMeasure(NamedTuple):
    """A measure of a person, or of where a sensor sits on the person, that an estimator takes through `with_body`.

    Attributes:
        name: as `with_body` calls it.
        unit: of the value.
        low: smallest value that is accepted.
        high: largest value that is accepted.
        meaning: what is measured, in words.
        option: the option of the command line that gives it, or "".
        default: the value that stands in for a missing one, or None where the text would be misleading.
        parameter: the parameter that the measure sets; "" is the parameter of the same name.
    """

    name: str
    unit: str
    low: float
    high: float
    meaning: str
    option: str = ""
    default: float | None = None
    parameter: str = ""


class MissingMeasure(NamedTuple):
    """What to note where measures are missing and the default stands in for them.

    Attributes:
        measures: names of the measures.
        text: what follows; a `str.format` template over the parameters `p`.
        any_one: one of the measures is enough.
    """

    measures: tuple[str, ...]
    text: str
    any_one: bool = False


class CommandOption(NamedTuple):
    """An option of the command line that only some estimators have.

    Attributes:
        name: such as "--level".
        help: what the option does, in words.
        kind: type of the value on the command line.
        low: smallest value, or None.
        high: largest value, or None.
        parse: value of the command line → value that is used; raises ValueError for what cannot be used.
        settings: (settings, value) → settings.
        params: (parameters, value) → parameters.
        notes: (recording, value) → notes about the recording.
        remark: value, or None where the option is not given → what to note before anything is computed, or "".
    """

    name: str
    help: str
    kind: type = float
    low: float | None = None
    high: float | None = None
    parse: Callable[[PyTree], PyTree] | None = None
    settings: Callable[[Settings, PyTree], Settings] | None = None
    params: Callable[[PyTree, PyTree], PyTree] | None = None
    notes: Callable[[Recording, PyTree], tuple[Note, ...]] | None = None
    remark: Callable[[PyTree], str] | None = None


class TotalColumn(NamedTuple):
    """A column of the table that `jgait estimate` prints.

    Attributes:
        name: key of the totals.
        heading: what the column is called.
        unit: of the printed number, or "".
        digits: after the decimal point.
        scale: from the total to the printed number.
        left: the column holds words, set to the left.
    """

    name: str
    heading: str
    unit: str = ""
    digits: int = 2
    scale: float = 1.0
    left: bool = False


def always(_: Estimate) -> bool:
    """Any estimate has it."""
    return True


class EstimateTable(NamedTuple):
    """A table that is written for a recording.

    Attributes:
        name: the end of the file's name.
        rows: "samples": one row for each sample, see `jgait.io.to_dataframe`; "strides": one row for each stride, see
            `jgait.io.strides_to_dataframe`, with a column `special` for the flags; or a function that gives the columns
            or the rows. Names of columns end with their unit.
        json: the key of the rows among the JSON numbers, or "" where these do not have them.
        when: which estimates have the table.
    """

    name: str
    rows: Literal["samples", "strides"] | Callable[[Estimate], PyTree]
    json: str = ""
    when: Callable[[Estimate], bool] = always


class EstimatedRecording(NamedTuple):
    """An estimate, and all that it was computed from.

    Attributes:
        recording: the signals.
        estimate: the result.
        params: the parameters.
        settings: the settings of the estimator.
    """

    recording: Recording
    estimate: Estimate
    params: PyTree
    settings: Settings


def of_estimate(made: EstimatedRecording) -> tuple[tuple[PyTree, ...], dict[str, PyTree]]:
    """The arguments of a figure that needs the estimate alone."""
    return (made.estimate,), {}


class EstimateFigure(NamedTuple):
    """A figure that is drawn for a recording.

    Attributes:
        plot: name of the function in `jgait.plot`.
        file: the end of the file's name.
        when: which estimates have the figure.
        arguments: positional and keyword arguments of the function; the title is added to them.
        caption: below the figure in a report, which draws a figure with a caption besides those of any estimate.
    """

    plot: str
    file: str
    when: Callable[[Estimate], bool] = always
    arguments: Callable[[EstimatedRecording], tuple[tuple[PyTree, ...], dict[str, PyTree]]] = of_estimate
    caption: str = ""


class StrideFlag(NamedTuple):
    """A property that makes a stride special.

    Attributes:
        name: as in `Estimate.diagnostics`.
        word: what tables in files call it.
        label: what figures and reports call it.
        meaning: what it means for the numbers, in a sentence.
        read: estimate → (strides,) bool, or None where the estimate does not state it.
        regular: whether such strides count in means.
        leaves_out: columns of the table of strides whose values of such strides do not count in means.
        grade: how serious it is, see `jgait.report.page.GRADES`.
    """

    name: str
    word: str
    label: str
    meaning: str
    read: Callable[[Estimate], PyTree]
    regular: bool = True
    leaves_out: tuple[str, ...] = ()
    grade: str = "check"


def no_numbers(_: Estimate) -> Mapping[str, PyTree]:
    """No numbers beyond those of every estimate."""
    return {}


class About(NamedTuple):
    """What an estimator states about itself.

    Attributes:
        title: what it estimates, from which sensors.
        needs: the columns of a recording that it needs, in words.
        source: authors and year of the method.
        default: the options of its default pipeline.
        paper: the options of the paper's pipeline, or None where there is none.
        measures: of a person.
        missing: what to note where measures are missing.
        options: of the command line, besides those of the measures.
        totals: estimate → rows of numbers of the whole recording, one row or one for each leg.
        columns: which of the totals `jgait estimate` prints, and how.
        caption: below the printed table; a `str.format` template over the settings.
        tables: that are written.
        figures: that are drawn.
        flags: of strides.
        numbers: estimate → JSON numbers beyond those of every estimate.
    """

    title: str = "Gait from wearable sensors"
    needs: str = ""
    source: str = ""
    default: object | None = None
    paper: object | None = None
    measures: tuple[BodyMeasure, ...] = ()
    missing: tuple[MissingMeasure, ...] = ()
    options: tuple[CommandOption, ...] = ()
    totals: Callable[[Estimate], list[dict[str, PyTree]]] = lambda _: [{}]
    columns: tuple[TotalColumn, ...] = ()
    caption: str = ""
    tables: tuple[EstimateTable, ...] = (EstimateTable("samples", "samples"),)
    figures: tuple[EstimateFigure, ...] = ()
    flags: tuple[StrideFlag, ...] = ()
    numbers: Callable[[Estimate], Mapping[str, PyTree]] = no_numbers
