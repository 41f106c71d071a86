"""Add `hardware/` and the recorded grasps to the site.

In the repository, pages link to `../hardware/README.md`, which links to `../docs/...`. On the site,
the folder is below the pages.
"""

from __future__ import annotations

import re
from itertools import takewhile
from pathlib import Path
from typing import Any

import griffe
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent
HARDWARE = ROOT / "hardware"
#: Text of docs/api that `docs/generate_api.py` writes, which the site has in full.
_FOR_FORGES = re.compile(r"<!-- from the docstring -->.*?<!-- end of docstring -->", re.S)


class DocstringFixes(griffe.Extension):
    """Corrections where griffe misreads docstrings."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite `array_like, shape (n,)`, which griffe would parse as Python."""
        if obj.docstring is not None:
            obj.docstring.value = obj.docstring.value.replace(", shape (", " of shape (")

    def on_attribute(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Use `#:` comments above a field as its docstring."""
        if attr.docstring is None and attr.lineno and isinstance(attr.filepath, Path):
            above = reversed(attr.lines_collection[attr.filepath][: attr.lineno - 1])
            comment = [*takewhile(lambda line: line.startswith("#:"), map(str.strip, above))]
            if comment:
                text = " ".join(line[2:].strip() for line in reversed(comment))
                attr.docstring = griffe.Docstring(text, parent=attr)

    def on_function(self, *, func: griffe.Function, **_: Any) -> None:
        """Set the default of each parameter; griffe repeats the first for joint descriptions."""
        for section in [] if func.docstring is None else func.docstring.parsed:
            if section.kind is griffe.DocstringSectionKind.parameters:
                for parameter in section.value:
                    if parameter.name in func.parameters:
                        parameter.value = func.parameters[parameter.name].default


def on_files(files: Files, *, config: Any) -> Files:
    """Add the page and the drawings of `hardware/`."""
    for path in sorted(HARDWARE.iterdir()):
        if path.suffix == ".md":
            text = path.read_text(encoding="utf-8").replace("](../docs/", "](../")
            files.append(File.generated(config, f"hardware/{path.name}", content=text))
        elif path.suffix == ".svg":
            files.append(File.generated(config, f"hardware/{path.name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Turn links to `hardware/` into links within the site; leave out what is for a forge alone."""
    markdown = _FOR_FORGES.sub("", markdown)
    return markdown.replace("](../hardware/", "](hardware/")


def on_page_content(html: str, **_: Any) -> str:
    """Give the page with the player its recorded grasps, so that it works without a server."""
    if 'id="grasp-player"' not in html:
        return html
    grasps = (ROOT / "docs" / "player" / "grasps.json").read_text(encoding="utf-8")
    return f'{html}\n<script type="application/json" id="grasp-data">{grasps}</script>'
