"""Brings `hardware/` into the site.

In the repository pages link to `../hardware/README.md` and it links to `../docs/...`; on the site
the folder lies below the pages.
"""

from __future__ import annotations

from itertools import takewhile
from pathlib import Path
from typing import Any

import griffe
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent
HARDWARE = ROOT / "hardware"


class AsWritten(griffe.Extension):
    """Lets docstrings through as they are written, where griffe would read something else."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Keep `array_like, shape (n,)`, which griffe takes for Python."""
        if obj.docstring is not None:
            obj.docstring.value = obj.docstring.value.replace(", shape (", " of shape (")

    def on_attribute(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Read what `#:` comments above a field have to say of it."""
        if attr.docstring is None and attr.lineno and isinstance(attr.filepath, Path):
            above = reversed(attr.lines_collection[attr.filepath][: attr.lineno - 1])
            comment = [*takewhile(lambda line: line.startswith("#:"), map(str.strip, above))]
            if comment:
                text = " ".join(line[2:].strip() for line in reversed(comment))
                attr.docstring = griffe.Docstring(text, parent=attr)

    def on_function(self, *, func: griffe.Function, **_: Any) -> None:
        """Give parameters described together each its own default; griffe repeats the first's."""
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
    """Turn links to `hardware/` into links within the site."""
    return markdown.replace("](../hardware/", "](hardware/")
