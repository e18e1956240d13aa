"""Experiments by paper: each reproduces what a paper reports or judges a part of jgait, and writes its numbers as rows.

`python -m experiments NAME` runs an experiment, `python -m experiments NAME.PART` one of its parts; see `__main__`.
"""

EXPERIMENTS = {
    "leg_ekf": "bennett2013",
    "duty_cycled_gyro": "udaya2010",
    "ankle_stride": "silva2017",
    "waist_ofdri": "kose2011",
    "stride_width_ekf": "potter",
    "foot_ins": "foot_ins",
    "simulator": "simulator",
    "tuning": "tuning",
    "cohort": "cohort",
    "layout": "layout",
}
"""Name of an experiment → its package (or module) in this folder. A package lists its `PARTS`, modules with a function
`rows(quick)`; a module has that function itself."""

BENCHMARKS = {"benchmark_filters": "benchmark.filters", "benchmark_import": "benchmark.imports"}
"""The same for comparisons with other libraries: they need the environment of `make bench`."""
