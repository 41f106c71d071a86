"""Draw the pictures of architecture.md: `python docs/generate_architecture.py [--check]`.

`distributions.svg` follows the `pyproject.toml` files; `frame.svg` is the way of a frame. With
--check nothing is written; the exit status is 1 if a picture differs.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS))
from generated import update_files  # noqa: E402

ROOT = DOCS.parent
_INK, _GREY, _WHITE = "#1f2933", "#52606d", "#ffffff"
_CORE, _PACKAGE, _DEVICE = "#dcebf5", "#e3f1e3", "#f6e7d2"
_HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
    'height="{height}" font-family="system-ui, sans-serif" font-size="13"><title>{title}</title>'
    f'<rect width="{{width}}" height="{{height}}" fill="{_WHITE}"/>'
    '<defs><marker id="a" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" '
    f'orient="auto"><path d="M0 0 L8 4 L0 8 Z" fill="{_INK}"/></marker></defs>'
)
#: Box of the way of a frame: name, text below it, x, y, colour.
_FRAME_BOXES = (
    ("board or twin", "divider, firmware", 20, 110, _DEVICE),
    ("sensor", "wire.py: Frame, counts", 230, 110, _CORE),
    ("grasp: runner", "the only loop: Observation", 440, 110, _CORE),
    ("GraspController.step", "once per observation", 650, 110, _CORE),
    ("recorder, views", "subscribers: files, page", 230, 10, _CORE),
    ("GraspState", "watchers: page, demo", 440, 10, _CORE),
    ("gripper", "driver or twin", 230, 230, _DEVICE),
    ("SampleReader", "ohm, change, excess", 440, 230, _CORE),
    ("ContactEstimate", "force by the sheet's law", 650, 230, _CORE),
    ("monitors", "alarm: end the grasp", 650, 330, _CORE),
    ("phase", "approach ... release", 440, 330, _CORE),
    ("safety filter", "largest safe step", 230, 330, _CORE),
    ("answers.py", "size, force, stiffness", 860, 110, _CORE),
    ("GraspDocument", "for every receiver", 860, 230, _CORE),
)
#: Arrow: from, to (corners of a polyline), and its label with place.
_FRAME_ARROWS: tuple[tuple[list[tuple[float, float]], str, float, float], ...] = (
    ([(190, 138), (230, 138)], "bytes", 196, 132),
    ([(400, 138), (440, 138)], "frame", 405, 132),
    ([(610, 138), (650, 138)], "", 0, 0),
    ([(470, 110), (470, 80), (315, 80), (315, 66)], "", 0, 0),
    ([(525, 110), (525, 66)], "", 0, 0),
    ([(680, 166), (680, 198), (525, 198), (525, 230)], "frame", 540, 192),
    ([(610, 258), (650, 258)], "Sample", 612, 250),
    ([(735, 286), (735, 330)], "", 0, 0),
    ([(650, 358), (610, 358)], "", 0, 0),
    ([(440, 358), (400, 358)], "", 0, 0),
    ([(315, 330), (315, 286)], "command, sent by the runner", 150, 312),
    ([(360, 230), (360, 185), (455, 185), (455, 166)], "state", 366, 180),
    ([(820, 138), (860, 138)], "", 0, 0),
    ([(945, 166), (945, 230)], "", 0, 0),
)


def draw_frame() -> str:
    """Draw the way of a frame from the board to the answer."""
    parts = [_HEAD.format(width=1050, height=400, title="The way of a frame")]
    parts += [_box(*box) for box in _FRAME_BOXES]
    for corners, label, x, y in _FRAME_ARROWS:
        parts.append(_arrow(corners))
        if label:
            parts.append(_text(x, y, label, size=11, fill=_GREY))
    return "\n".join([*parts, "</svg>\n"])


def read_distributions() -> dict[str, tuple[set[str], list[str], str]]:
    """Return dependencies on others, entry-point groups and folder of each distribution."""
    found = {}
    for path in (ROOT / "pyproject.toml", *sorted(ROOT.glob("packages/*/pyproject.toml"))):
        project = tomllib.loads(path.read_text(encoding="utf-8"))["project"]
        needed = {re.split(r"[\[<>=~ ]", one)[0] for one in project.get("dependencies", [])}
        groups = sorted(
            group.removeprefix("palpate.")
            for group in project.get("entry-points", {})
            if group.startswith("palpate.")
        )
        folder = str(path.parent.relative_to(ROOT))
        found[project["name"]] = (needed, groups, "src/palpate" if folder == "." else folder)
    return {
        name: (needed & found.keys(), groups, place)
        for name, (needed, groups, place) in found.items()
    }


def draw_distributions() -> str:
    """Draw the distributions, each above those that it needs."""
    found = read_distributions()

    def depth(name: str) -> int:
        return 1 + max(map(depth, found[name][0]), default=-1)

    levels: dict[int, list[str]] = {}
    for name in found:
        levels.setdefault(depth(name), []).append(name)
    width, gap, tall = 172, 16, 66
    # A package stands near the one that it needs.
    row = levels[1]
    row.sort(key=lambda name: not any(name in found[other][0] for other in found))
    wide = len(row) * (width + gap) + gap
    top = {level: 20 + (max(levels) - level) * 130 for level in levels}
    place: dict[str, float] = {name: gap + k * (width + gap) for k, name in enumerate(row)}
    taken: dict[float, float] = {}
    for name in levels[2]:
        (below,) = found[name][0] - {"palpate"}
        place[name] = max(place[below], taken.get(2, gap))
        taken[2] = place[name] + width + gap
    place["palpate"] = wide / 2 - width / 2
    height = max(top.values()) + tall + 20
    parts = [_HEAD.format(width=wide, height=height, title="The distributions")]
    for name, (needed, _, _) in found.items():
        for below in sorted(needed):
            # A package that needs another one needs the core through it, too.
            if below == "palpate" and len(needed) > 1:
                continue
            start = (place[name] + width / 2, top[depth(name)] + tall)
            parts.append(_arrow([start, (place[below] + width / 2, top[depth(below)])]))
    for name, (_, groups, folder) in found.items():
        colour = _CORE if name == "palpate" else _PACKAGE
        at, up = place[name], top[depth(name)]
        parts.append(_box(name, folder, at, up, colour, width=width, tall=tall))
        joined = f"joins: {', '.join(groups)}" if groups else ""
        parts.append(_text(at + width / 2, up + 57, joined, size=9, anchor="middle", fill=_GREY))
    return "\n".join([*parts, "</svg>\n"])


def _box(
    name: str,
    below: str,
    x: float,
    y: float,
    colour: str,
    *,
    width: float = 170,
    tall: float = 56,
) -> str:
    middle = x + width / 2
    size = 13 if len(name) < 20 else 11
    return "\n".join(
        (
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{tall:g}" rx="6" '
            f'fill="{colour}" stroke="{_GREY}"/>',
            _text(middle, y + 23, name, size=size, anchor="middle", weight=600),
            _text(middle, y + 41, below, size=11, anchor="middle", fill=_GREY),
        )
    )


def _arrow(corners: list[tuple[float, float]]) -> str:
    points = " ".join(f"{x:g},{y:g}" for x, y in corners)
    return f'<polyline points="{points}" fill="none" stroke="{_INK}" marker-end="url(#a)"/>'


def _text(
    x: float,
    y: float,
    text: str,
    *,
    size: int,
    anchor: str = "start",
    weight: int = 400,
    fill: str = _INK,
) -> str:
    return (
        f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" font-size="{size}" '
        f'font-weight="{weight}" fill="{fill}">{text}</text>'
    )


def main() -> int:
    """Write or check both pictures."""
    pictures = {"distributions.svg": draw_distributions(), "frame.svg": draw_frame()}
    return update_files({DOCS / "images" / name: text for name, text in pictures.items()})


if __name__ == "__main__":
    sys.exit(main())
