"""Experiments by paper: each reproduces what a paper reports or judges a part of jgait, and writes its numbers as rows.

`python -m experiments NAME` runs an experiment, `python -m experiments NAME.PART` one of its parts; see `__main__`.
"""

from pathlib import Path

FIRST = {
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
"""Name of an experiment → its package in this folder, in the order of the table; others follow by their names."""


def _others() -> list[str]:
    """The further packages and modules in this folder; each gave its experiment its name."""
    known = {"common", "benchmark", *FIRST.values()}
    paths = [
        path for path in Path(__file__).parent.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()
    ]
    return sorted(path.stem for path in paths if path.stem not in known and not path.stem.startswith("_"))


EXPERIMENTS = FIRST | {name: name for name in _others()}
"""Name of an experiment → its package (or module). A package lists its `PARTS`, modules with a function `rows(quick)`;
a module has that function itself."""

BENCHMARKS = {
    "benchmark_filters": "benchmark.filters",
    "benchmark_core": "benchmark.core",
    "benchmark_import": "benchmark.imports",
    "benchmark_latency": "benchmark.latency",
    "benchmark_tune": "benchmark.tune",
}
"""The same for comparisons with other libraries: they need the environment of `make bench`."""
