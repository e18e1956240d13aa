"""What mkdocs calls while it builds the site: pages that are made, `{{ … }}` in those that are written, formulae."""

import re
import shlex
from pathlib import Path
from typing import Any

import api
import docstring_sections
import gallery
import mathml
import sources
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]


def _docstring(module: str, section: str = "") -> str:
    """The beginning of a module's docstring, or one of its sections."""
    intro, named = docstring_sections.sections(docstring_sections.cleaned(api.modules()[module]))
    if not section:
        return intro
    if section not in named:
        raise ValueError(f"the docstring of {module} has no section {section!r}; it has {', '.join(named)}")
    return named[section]


def _changelog() -> str:
    return sources.local_links_as_text((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))


DIRECTIVES = {
    "docstring": _docstring,
    "readme": sources.readme,
    "accuracy": sources.accuracy,
    "experiments": sources.experiments,
    "command_line": sources.command_line,
    "formats": sources.formats,
    "methods": sources.methods,
    "changelog": _changelog,
}
"""What may stand alone on a line of a page: `{{ name argument … }}`."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Navigation of what is made."""
    books = gallery.notebooks(ROOT / "notebooks")
    pages = ["gallery/index.md", *(f"gallery/{book.stem}.md" for book in books)]
    for entry in config.nav or []:
        if "Gallery" in entry:
            entry["Gallery"] = pages
        if "Methods" in entry:
            entry["Methods"] = ["methods/index.md", *sources.pages_of_methods()]
        if "API" in entry:
            entry["API"] = api.navigation()
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of modules and notebooks."""

    def add(uri: str, content: str | bytes) -> None:
        files.append(File.generated(config, uri, content=content))

    add("api/index.md", api.index())
    for name in api.modules():
        add(api.uri(name), api.page(name))
    pages = {}
    for book in gallery.notebooks(ROOT / "notebooks"):
        markdown, pictures = gallery.page(book)
        pages[f"{book.stem}.md"] = markdown
        add(f"gallery/{book.stem}.md", markdown)
        for name, data in pictures.items():
            add(f"gallery/{name}", data)
    add("gallery/index.md", gallery.index(pages))
    return files


def on_page_markdown(markdown: str, **kwargs: Any) -> str:
    """Put in what a page asks for."""
    del kwargs

    def one(found: re.Match[str]) -> str:
        name, *arguments = shlex.split(found[1])
        if name not in DIRECTIVES:
            raise ValueError(f"{{{{ {found[1]} }}}} is none of {', '.join(DIRECTIVES)}")
        return DIRECTIVES[name](*arguments)

    return re.sub(r"^\{\{ (.+?) \}\}$", one, markdown, flags=re.MULTILINE)


def on_page_content(html: str, **kwargs: Any) -> str:
    """Formulae as MathML."""
    del kwargs
    return mathml.with_mathml(html)
