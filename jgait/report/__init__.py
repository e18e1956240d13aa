"""One self-contained HTML page about a recording or a cohort, for readers who do not program.

`of_estimate` makes the page of one recording by one estimator, `of_analysis` by all its sensors, `of_cohort` the page
of many people; all give a `Report`, which a notebook shows and `save` writes. `jgait report` does the same from files.
"""

from jgait.report.cohort import of_cohort
from jgait.report.made import Made
from jgait.report.page import Report
from jgait.report.recording import of_analysis, of_estimate

__all__ = ["Made", "Report", "of_analysis", "of_cohort", "of_estimate"]
