"""Figures of reports: content, and None without data."""

from __future__ import annotations

from datetime import UTC, timedelta

import pytest
from tests.factories import NOON, make_grasp

from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate.plots.inline_svg import THEME, inline_svg, page_figure
from palpate.plots.item_history import history_figure
from palpate.plots.many_items import kind_of, softening_figure
from palpate.plots.style import INK
from palpate.produce.records import About, Grasp, Item, Source, Verdict
from palpate.produce.store.item_history import ItemHistory


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


def make_verdict(
    text: str, *, about: About = About.RIPENESS, source: Source = Source.PALPATE
) -> Verdict:
    return Verdict(item_id="A17", about=about, text=text, given_at=NOON, source=source)


def test_history_figure_starts_at_zero_and_limits_wide_intervals() -> None:
    grasps = [
        grasp(24 * day, stiffness=4 - day, above=300.0 if day == 1 else 0.5) for day in (0, 1, 2)
    ]
    figure = history_figure(page(*grasps), "stiffness_n_per_mm", label="stiffness (N/mm)")
    low, high = figure.axes[0].get_ylim()
    assert low == 0
    assert 4 < high < 20
    assert figure.axes[0].get_ylabel() == "stiffness (N/mm)"


def test_history_figure_marks_verdicts_of_people_only() -> None:
    verdicts = (make_verdict("ripe", source=Source.PERSON), make_verdict("hard"))
    history = page(grasp(0), verdicts=verdicts)
    figure = history_figure(history, "size_mm", label="size (mm)", zone=UTC)
    assert [text.get_text() for text in figure.axes[0].texts] == ["ripe"]


def test_softening_figure_shows_the_mean_of_each_of_two_days() -> None:
    assert softening_figure([page(grasp(0), grasp(1))]) is None
    history = page(grasp(0), grasp(48, stiffness=1.0), grasp(48.1, stiffness=4.0))
    figure = softening_figure([history], zone=UTC)
    assert figure.axes[0].lines[0].get_ydata().tolist() == [3.0, 2.0]


@pytest.mark.parametrize(
    ("kind", "verdicts", "name"),
    [
        ("kiwi", (make_verdict("lime", about=About.IDENTITY),), "kiwi"),
        (None, (make_verdict("lime", about=About.IDENTITY),), "lime"),
        (None, (make_verdict("ripe"),), "not named"),
    ],
)
def test_kind_of_prefers_the_kind_stated_by_a_person(
    kind: str | None, verdicts: tuple[Verdict, ...], name: str
) -> None:
    assert kind_of(page(kind=kind, verdicts=verdicts)) == name


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
