"""Formulae as MathML, made while the site is built: pages need no script and no network to show them."""

import html
import re

from latex2mathml.converter import convert

_SPAN = re.compile(r'<(span|div) class="arithmatex">\s*\\([(\[])(.*?)\\[)\]]\s*</\1>', re.DOTALL)


_BOLD = {chr(0x3B1 + k): chr(0x1D736 + k) for k in range(25)}
"""Greek letters → bold italic ones: browsers take the letter, not an attribute."""


def formula(latex: str, *, block: bool) -> str:
    """One formula as MathML Core, which is what browsers show."""
    # Names of functions are identifiers, which MathML sets without a space before their argument.
    latex = re.sub(r"\\(sin|cos|exp|ln|arctan)(?= *(\\[a-zA-Z]|[a-zA-Z0-9]))", r"\\\1\\,", latex)
    latex = re.sub(r"(?<=[A-Za-z0-9}]) ?\\(sin|cos)", r"\\,\\\1", latex)
    told = convert(latex, display="block" if block else "inline")
    told = re.sub(r'<mtable displaystyle="true"[^>]*>', '<mtable class="aligned">', told)
    told = re.sub(r' columnalign="(\w+)"', r' style="text-align: \1; text-align: -webkit-\1"', told)
    told = re.sub(r"<mo>(min|max)</mo>", r"<mi>\1</mi>", told)
    told = re.sub(r"<mo[^>]*>&#x0007C;</mo>", '<mo stretchy="false" lspace="0" rspace="0">|</mo>', told)
    return re.sub(r'<mi mathvariant="bold-italic">&#x0?(\w+);</mi>', _bold, told)


def _bold(found: re.Match[str]) -> str:
    letter = chr(int(found[1], 16))
    return f"<mi>{_BOLD.get(letter, letter)}</mi>"


def with_mathml(page: str) -> str:
    """A page whose formulae, as `pymdownx.arithmatex` marks them, are MathML."""

    def one(found: re.Match[str]) -> str:
        block = found[2] == "["
        told = formula(html.unescape(found[3]).strip(), block=block)
        return f'<div class="formula">{told}</div>' if block else told

    return _SPAN.sub(one, page)
