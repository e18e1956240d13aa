"""Formulae as MathML, made while the site is built: pages need no script and no network to show them."""

import html
import re

from latex2mathml.converter import convert

_SPAN = re.compile(r'<(span|div) class="arithmatex">\s*\\([(\[])(.*?)\\[)\]]\s*</\1>', re.DOTALL)


def with_mathml(page: str) -> str:
    """A page whose formulae, as `pymdownx.arithmatex` marks them, are MathML."""

    def one(found: re.Match[str]) -> str:
        latex = html.unescape(found[3]).strip()
        block = found[2] == "["
        # Names of functions are upright identifiers, which MathML sets without a space before their argument.
        latex = re.sub(r"\\(sin|cos|exp|ln|arctan)(?= *(\\[a-zA-Z]|[a-zA-Z0-9]))", r"\\\1\\,", latex)
        told = convert(latex, display="block" if block else "inline")
        told = told.replace('columnalign="left"', 'style="text-align: left"')
        told = told.replace('columnalign="right"', 'style="text-align: right"')
        told = re.sub(r"<mi>&</mi>", "", told)
        return f'<div class="formula">{told}</div>' if block else told

    return _SPAN.sub(one, page)
