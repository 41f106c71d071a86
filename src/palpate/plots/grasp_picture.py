"""Picture of a simulated grasp as SVG, still or moving, without any library for plots."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

from palpate.demo.grasp import DemoGrasp, GraspMoment
from palpate.grasp.verdict import verdict
from palpate.measurement import Measurement
from palpate.plots.pixel_colors import pixel_color

_WIDTH, _HEIGHT = 760, 344
_INK, _GREY, _BLUE, _ORANGE, _GREEN = "#222222", "#6b7280", "#0072B2", "#D55E00", "#00775a"
#: Chart: left, top, right and bottom edges.
_LEFT, _TOP, _RIGHT, _BOTTOM = 290, 72, 740, 254
#: Width of the name of a phase.
_NAME_WIDTH = 56
#: Hand: centre, largest half opening, width of a finger, and size of a pixel.
_MIDDLE, _HALF, _FINGER, _CELL = 130, 84, 12, 34
#: Moments between two key frames of the moving picture, and seconds of pause at its end.
_EVERY, _PAUSE_S = 3, 3.0


def draw_grasp(grasp: DemoGrasp, *, moving: bool = False) -> str:
    """Return the picture of a grasp: fingers and pixels, force with its interval, verdict.

    Parameters
    ----------
    moving : bool
        Whether the picture plays the grasp (SMIL, in an endless loop); otherwise it shows the hold.

    Examples
    --------
    >>> from palpate.demo.grasp import run_demo_grasp
    >>> draw_grasp(run_demo_grasp()).startswith("<svg")
    True
    """
    subject, result = grasp.document.subject or "object", grasp.document.result
    title = f"palpate: {subject}, simulated (seed {grasp.seed})"
    film = _Film(grasp.moments[::_EVERY] if moving else [_held(grasp.moments)], moving=moving)
    highest_n = max(1.0, *(_limits(m.force_n)[1] for m in grasp.moments if m.force_n is not None))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
        f'width="{_WIDTH}" height="{_HEIGHT}" font-family="system-ui, sans-serif" font-size="13">',
        f"<title>{title}</title>",
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" rx="8" fill="#ffffff"/>',
        _text(20, 28, title, weight=600, size=15),
        *_draw_hand(grasp, film),
        *_draw_chart(grasp, film, highest_n=1.1 * highest_n),
    ]
    words = verdict(result, target_force_n=grasp.document.target_force_n)
    answer = f"{str(words['text']).capitalize()}, {words['firmness']}"
    answers = [
        f"{name} {one.text(digits=digits)} ({one.low:.{digits}f} to {one.high:.{digits}f}) {unit}"
        for name, one, digits, unit in (
            ("force", result.force_n, 2, "N"),
            ("size", result.size_mm, 1, "mm"),
            ("stiffness", result.stiffness_n_per_mm, 1, "N/mm"),
        )
        if one is not None and one.has_value
    ]
    parts += [
        f"<g>{film.shown_from(grasp.moments, 'release')}",
        _text(20, 310, answer, weight=600, fill=_GREEN, size=15),
        _text(20, 331, " · ".join(answers)),
        "</g></svg>\n",
    ]
    return "\n".join(parts)


class _Film:
    """Attributes of the picture over the moments shown; constant in a still picture."""

    def __init__(self, moments: Sequence[GraspMoment], *, moving: bool) -> None:
        self.moments, self._moving = moments, moving
        self._end_s = moments[-1].time_s + _PAUSE_S
        times = [f"{moment.time_s / self._end_s:.3g}" for moment in moments]
        self._times = ";".join(["0", *times[1:], "1"])

    def element(self, name: str, constant: str, **varied: Callable[[GraspMoment], str]) -> str:
        """Return an element with constant attributes, and attributes that follow the grasp."""
        values = {key: [value(moment) for moment in self.moments] for key, value in varied.items()}
        first = " ".join(f'{key}="{found[0]}"' for key, found in values.items())
        if not self._moving:
            return f"<{name} {constant} {first}/>"
        moves = "".join(
            f'<animate attributeName="{key}" dur="{self._end_s:.2f}s" repeatCount="indefinite" '
            f'keyTimes="{self._times}" values="{";".join([*found, found[-1]])}"/>'
            for key, found in values.items()
            if len(set(found)) > 1
        )
        return f"<{name} {constant} {first}>{moves}</{name}>"

    def shown_from(self, moments: Sequence[GraspMoment], phase: str) -> str:
        """Return an animation that shows its parent from a phase on; empty in a still picture."""
        if not self._moving:
            return ""
        at = next((m.time_s for m in moments if m.phase.value == phase), moments[-1].time_s)
        return (
            f'<animate attributeName="opacity" dur="{self._end_s:.2f}s" repeatCount="indefinite" '
            f'calcMode="discrete" keyTimes="0;{at / self._end_s:.3g}" values="0;1"/>'
        )


def _held(moments: Sequence[GraspMoment]) -> GraspMoment:
    """Return the last moment of the hold, or of the grasp if nothing was held."""
    return next((m for m in reversed(moments) if m.phase.value == "hold"), moments[-1])


def _draw_hand(grasp: DemoGrasp, film: _Film) -> list[str]:
    """Draw the fingers, the object between them, and the pixels of each finger."""
    widest = max(moment.width_mm for moment in grasp.moments)
    scale = _HALF / widest
    closed = min(moment.width_mm for moment in grasp.moments)
    parts = [
        f'<ellipse cx="{_MIDDLE}" cy="100" rx="{_start_mm(grasp.moments, closed) * scale:.1f}" '
        f'ry="34" fill="#f3c9c1" stroke="{_GREY}"/>'
    ]
    bar = f'y="62" width="{_FINGER}" height="76" rx="3" fill="{_INK}"'
    parts += [
        film.element("rect", bar, x=lambda m: f"{_MIDDLE - m.width_mm * scale - _FINGER:.1f}"),
        film.element("rect", bar, x=lambda m: f"{_MIDDLE + m.width_mm * scale:.1f}"),
    ]
    opening = film.moments[0].width_mm if len(film.moments) == 1 else None
    if opening is not None:
        parts.append(_text(_MIDDLE, 156, f"{opening:.1f} mm", anchor="middle", fill=_GREY))
    fingers = sorted(set(grasp.finger_of_row))
    columns = grasp.moments[0].change_percent.shape[1]
    for place, finger in enumerate(fingers):
        rows = [row for row, of in enumerate(grasp.finger_of_row) if of == finger]
        x0 = _MIDDLE + (place - 0.5 * (len(fingers) - 1)) * 124 - 0.5 * columns * _CELL
        for height, row in enumerate(rows):
            for column in range(columns):
                place_of = f'x="{x0 + column * _CELL:.0f}" y="{166 + height * _CELL}"'
                size = f'width="{_CELL - 2}" height="{_CELL - 2}"'
                fill = partial(_color, row=row, column=column)
                parts.append(film.element("rect", f"{place_of} {size}", fill=fill))
    bottom = 166 + _CELL * max(grasp.finger_of_row.count(finger) for finger in fingers) + 14
    parts.append(_text(_MIDDLE, bottom, "pixels of both fingers", anchor="middle", fill=_GREY))
    return parts


def _start_mm(moments: Sequence[GraspMoment], closed: float) -> float:
    """Return the width at which the fingers first rested on the object, mm."""
    found = [m.width_mm for m in moments if m.phase.value == "squeeze"]
    return found[0] if found else closed


def _draw_chart(grasp: DemoGrasp, film: _Film, *, highest_n: float) -> list[str]:
    """Draw the force over time with its interval, the target and the phases."""
    end_s = grasp.moments[-1].time_s

    def x(time_s: float) -> float:
        return _LEFT + (_RIGHT - _LEFT) * time_s / end_s

    def y(force_n: float) -> float:
        return _BOTTOM - (_BOTTOM - _TOP) * min(force_n, highest_n) / highest_n

    parts = []
    for tick_n in range(math.floor(highest_n) + 1):
        parts.append(_line(_LEFT, y(tick_n), _RIGHT, y(tick_n), "#e5e7eb"))
        parts.append(_text(_LEFT - 8, y(tick_n) + 4, f"{tick_n}", anchor="end", fill=_GREY))
    parts += [
        _text(x(tick_s), _BOTTOM + 16, f"{tick_s}", anchor="middle", fill=_GREY)
        for tick_s in range(math.floor(end_s) + 1)
    ]
    parts.append(_text(_RIGHT, _BOTTOM + 32, "s", anchor="end", fill=_GREY))
    parts.append(_text(_LEFT - 8, _TOP - 2, "N", anchor="end", fill=_GREY))
    target_n = grasp.document.target_force_n
    if target_n is not None:
        parts.append(_line(_LEFT, y(target_n), _RIGHT, y(target_n), _ORANGE, dash="5 4"))
        parts.append(_text(_LEFT + 4, y(target_n) - 5, f"target {target_n:g} N", fill=_ORANGE))
    reveal = film.element(
        "rect",
        f'x="{_LEFT}" y="0" height="{_HEIGHT}"',
        width=lambda m: f"{_RIGHT - _LEFT if len(film.moments) == 1 else x(m.time_s) - _LEFT:.1f}",
    )
    parts.append(f'<clipPath id="shown">{reveal}</clipPath><g clip-path="url(#shown)">')
    known = [(m.time_s, m.force_n) for m in grasp.moments if m.force_n is not None]
    ends = [(x(time_s), *map(y, _limits(force))) for time_s, force in known]
    outline = [f"{at:.1f},{low:.1f}" for at, low, _ in ends]
    outline += [f"{at:.1f},{high:.1f}" for at, _, high in reversed(ends)]
    parts.append(f'<polygon points="{" ".join(outline)}" fill="{_BLUE}" opacity="0.25"/>')
    curve = " ".join(f"{x(time_s):.1f},{y(force.middle):.1f}" for time_s, force in known)
    parts.append(f'<polyline points="{curve}" fill="none" stroke="{_BLUE}" stroke-width="2"/>')
    before, last_at, height = "", -math.inf, _TOP
    for moment in grasp.moments:
        if moment.phase.value != before:
            before = moment.phase.value
            at = x(moment.time_s)
            # Names of short phases would overlap in one row.
            height = _TOP - 16 if at - last_at < _NAME_WIDTH and height > _TOP - 16 else _TOP - 2
            last_at = at
            edge = at + _NAME_WIDTH > _RIGHT
            parts.append(_line(at, height - 10, at, _BOTTOM, _GREY, dash="2 3"))
            name_at = at - 4 if edge else at + 4
            parts.append(_text(name_at, height, before, anchor="end" if edge else "start"))
    parts.append("</g>")
    if known:
        label = "force, 90 % interval"
        parts.append(_text(_LEFT + 4, _BOTTOM + 32, label, fill=_BLUE))
    return parts


def _limits(force: Measurement) -> tuple[float, float]:
    """Return the ends of an interval, an unknown upper end as the value."""
    return force.low, force.high if math.isfinite(force.high) else force.middle


def _color(moment: GraspMoment, *, row: int, column: int) -> str:
    change_percent = float(moment.change_percent[row, column])
    if math.isnan(change_percent):
        return "#8a8a8a"
    return "#{:02x}{:02x}{:02x}".format(*pixel_color(change_percent))


def _line(x1: float, y1: float, x2: float, y2: float, stroke: str, *, dash: str = "") -> str:
    style = f' stroke-dasharray="{dash}"' if dash else ""
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{stroke}"{style}/>'
    )


def _text(
    x: float,
    y: float,
    text: str,
    *,
    anchor: str = "start",
    fill: str = _INK,
    weight: int = 400,
    size: int = 13,
) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{fill}" '
        f'font-weight="{weight}" font-size="{size}">{text}</text>'
    )
