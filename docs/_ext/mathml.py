"""Formulae as MathML, made while the site is built: pages need no script and no network to show them."""

import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator


def formula(latex: str, *, block: bool) -> str:
    """One formula. Browsers show bold Greek letters as letters of their own, and set no spaces beside functions."""
    latex = re.sub(r"\\boldsymbol(\\[a-z]+)", r"\\mathbfit{\1}", latex)
    latex = re.sub(r"\\(sin|cos|exp|ln|arctan)(?! *\\left)(?= *\\?[a-zA-Z0-9])", r"\\\1\\,", latex)
    latex = re.sub(r"(?<=[A-Za-z0-9})]) ?\\(sin|cos)", r"\\,\\\1", latex)
    found = re.sub(r"<mo>(min|max)</mo>", r"<mi>\1</mi>", str(tex2mathml(latex, as_block=block)))
    return re.sub(r"<mo[^>]*>([|/])</mo>", r'<mo stretchy="false" lspace="0" rspace="0">\1</mo>', found)


def inline(self: HTML5Translator, node: nodes.math) -> None:
    """Write a formula of a sentence."""
    self.body.append(formula(node.astext(), block=False))
    raise nodes.SkipNode


def display(self: HTML5Translator, node: nodes.math_block) -> None:
    """Write a formula of its own."""
    self.body.append(f'<div class="formula">{formula(node.astext(), block=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
