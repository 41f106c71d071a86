"""Brings `hardware/` into the site, and turns links that lead there so that they work in both.

In the repository pages link to `../hardware/README.md` and it links to `../docs/...`; on the site
the folder lies below the pages.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

HARDWARE = Path(__file__).resolve().parent / "hardware"


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
