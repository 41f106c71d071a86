"""Whether text in a figure's PDF can be edited and searched: what journals ask for."""

from __future__ import annotations

from pathlib import Path


def check_fonts(pdf: Path) -> None:
    """Check that a PDF embeds TrueType fonts (Type 42), and no outlines (Type 3)."""
    document = pdf.read_bytes()
    assert b"/FontFile2" in document, pdf.name
    assert b"/Type3" not in document, pdf.name


def check_all_fonts(folder: Path) -> None:
    """Check every PDF of a folder that has some."""
    figures = sorted(folder.glob("*.pdf"))
    assert figures
    for pdf in figures:
        check_fonts(pdf)
