"""Figures of reports: content, and None without data."""

from __future__ import annotations

from datetime import timedelta

from packages.station.tests.factories import NOON, make_grasp

from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate.plots.style import INK
from palpate_station.plots.inline_svg import THEME, inline_svg, page_figure
from palpate_station.records import Grasp, Item, Verdict
from palpate_station.store.item_history import ItemHistory


def make_measurement(value: float, unit: str, *, above: float = 0.5) -> Measurement:
    return Measurement(value=value, low=value - 0.5, high=value + above, unit=unit)


def grasp(hours: float, *, stiffness: float = 3.0, above: float = 0.5) -> Grasp:
    return make_grasp(
        taken_at=NOON + timedelta(hours=hours),
        outcome=Outcome.HELD if hours else Outcome.SLIPPED,
        measurements={
            "stiffness_n_per_mm": make_measurement(stiffness, "n_per_mm", above=above),
            "size_mm": make_measurement(60.0, "mm"),
        },
        pixel_settled_percent=((-30.0, None), (-60.0, -5.0)),
        angle_deg=90.0 * (hours // 24),
    )


def page(
    *grasps: Grasp, kind: str | None = "avocado", verdicts: tuple[Verdict, ...] = ()
) -> ItemHistory:
    return ItemHistory(item=Item(item_id="A17", kind=kind), grasps=grasps, verdicts=verdicts)


def test_inline_svg_uses_css_variables_and_escapes_text() -> None:
    with page_figure() as (figure, (axis,)):
        axis.plot([0, 1], [0, 1], color=INK)
        axis.set_title("<b>")
        text = inline_svg(figure, label='a "label"')
    assert text.startswith("<svg")
    assert 'aria-label="a &quot;label&quot;"' in text
    assert "&lt;b&gt;" in text
    assert "var(--ink)" in text
    assert "var(--grid)" in text
    assert 'width="' not in text.split(">")[0]
    assert not any(colour.lower() in text.lower() for colour, _, _, _ in THEME)
