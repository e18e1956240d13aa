"""Convert a user's files and arrays to a `Recording`, and an `Estimate` to tables and files.

Only this package converts units, replaces NaN by a mask, and checks recordings: a structure, a clock or units that make
a recording unusable raise `RecordingError`; doubtful properties become notes.
"""

import importlib
from typing import TYPE_CHECKING, Any

from jgait.io.checks import quality_notes
from jgait.io.formats.dialects import recording_from_gaitmap, recording_from_mobgap
from jgait.io.formats.mobilised import mobilised_trials, read_mobilised
from jgait.io.formats.registry import FORMATS, format_of, read
from jgait.io.params import (
    PRESETS,
    made_of,
    params_file,
    preset_file,
    preset_names,
    read_params,
    write_params,
    write_preset,
)
from jgait.io.recording import recording_from_arrays
from jgait.io.references import reference_from_tables, strides_from_dataframe
from jgait.io.results import Results, analysis_to_dataframes
from jgait.io.strides import MobgapTables, strides_to_dataframe, to_gaitmap, to_gaitmap_parameters, to_mobgap
from jgait.io.tables import read_csv, recording_from_dataframe
from jgait.io.write import read_table, recording_to_dataframe, to_dataframe, write_csv, write_table
from jgait.params import units

if TYPE_CHECKING:
    from jgait.io.formats.c3d import Capture, CaptureEvent, read_c3d
    from jgait.io.formats.opensim import OpenSimMotion, opensim_reference, read_opensim

__all__ = [
    "FORMATS",
    "PRESETS",
    "Capture",
    "CaptureEvent",
    "MobgapTables",
    "OpenSimMotion",
    "Results",
    "analysis_to_dataframes",
    "format_of",
    "made_of",
    "mobilised_trials",
    "opensim_reference",
    "params_file",
    "preset_file",
    "preset_names",
    "quality_notes",
    "read",
    "read_c3d",
    "read_csv",
    "read_mobilised",
    "read_opensim",
    "read_params",
    "read_table",
    "recording_from_arrays",
    "recording_from_dataframe",
    "recording_from_gaitmap",
    "recording_from_mobgap",
    "recording_to_dataframe",
    "reference_from_tables",
    "strides_from_dataframe",
    "strides_to_dataframe",
    "to_dataframe",
    "to_gaitmap",
    "to_gaitmap_parameters",
    "to_mobgap",
    "units",
    "write_csv",
    "write_params",
    "write_preset",
    "write_table",
]

_MODULES = dict.fromkeys(("Capture", "CaptureEvent", "read_c3d"), "c3d")
_MODULES |= dict.fromkeys(("OpenSimMotion", "opensim_reference", "read_opensim"), "opensim")


def __getattr__(name: str) -> Any:
    """A name of a module that reads references, which is imported when it is first asked for."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"jgait.io.formats.{_MODULES[name]}"), name)
