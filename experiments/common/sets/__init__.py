"""Further public sets, which only experiments load; they are loaded and fetched as those of jgait.

`from experiments.common.sets import datasets` is `jgait.datasets` that knows them too. Each set is a reader and a JSON
file, as in `jgait/datasets`.
"""

from jgait import datasets

__all__ = ["datasets"]

datasets.register(__name__, "tripod", "gaitmap_example", "xio_gait", "ipol_gait", "mobgap_lab")
