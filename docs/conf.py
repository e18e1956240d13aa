"""The documentation site: `make docs`. `_ext` makes the pages of modules and notebooks; nothing needs a network."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent / "_ext"), str(Path(__file__).parents[1])]

project = "jgait"
extensions = ["myst_nb", "sphinx.ext.autodoc", "mathml", "pages"]
exclude_patterns = ["_ext"]
add_module_names = False
smartquotes = False
html_math_renderer = "mathml"

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # `make docs` runs the notebooks

autodoc_default_options = {"members": True, "ignore-module-all": True}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 100
python_use_unqualified_type_names = True

html_theme = "pydata_sphinx_theme"
html_title = "jgait"
html_static_path = ["assets"]
html_css_files = ["style.css"]
html_show_sourcelink = html_copy_source = False
html_sidebars = {"changelog": [], "experiments": []}  # they have no pages beside them
html_theme_options = {"collapse_navigation": True}
