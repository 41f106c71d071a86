"""The health check on frames of the twin, with and without injected faults."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest

from palpate.sensor.array import RIGID_LAYOUT, ArrayLayout, LinkCounters
from palpate.sensor.findings import Severity
from palpate.sensor.frame_columns import FrameColumns
from palpate.sensor.health import Health, check_health
from palpate.signal.circuit import Divider, ohm_to_volts, volts_to_counts
from palpate.signal.crosstalk import floating_readings_ohm
from palpate.twin.devices import TwinArray
from palpate.twin.world import World

RATE_HZ = 15.0


@cache
def twin_rest(
    seed: int, level: str = "lab", gripper: str = "rigid"
) -> tuple[FrameColumns, ArrayLayout]:
    """Return ten seconds of frames without contact."""
    world = World(None, seed=seed, level=level, gripper="soft" if gripper == "soft" else "rigid")
    array = TwinArray(world)
    return FrameColumns.from_frames([array.read(timeout_s=1.0) for _ in range(150)]), world.layout


def with_counts(stretch: FrameColumns, value: object, *pixel: object) -> FrameColumns:
    """Replace the counts of a pixel, of a line, or of all."""
    counts = stretch.counts.copy()
    counts[(slice(None), *pixel)] = value
    return replace(stretch, counts=counts)


def codes(health: Health) -> list[tuple[str, str]]:
    return [(found.code, found.where) for found in health.findings]


@pytest.mark.parametrize(("end", "code"), [(0, "open"), (1023, "short")])
@pytest.mark.parametrize("oversampling", [1, 16])
def test_health_check_reports_a_dead_pixel_despite_converter_noise(
    end: int, code: str, oversampling: int
) -> None:
    stretch, layout = twin_rest(1)
    noise = np.random.default_rng(1).normal(end, 0.5, (oversampling, 150))
    dead = np.clip(np.rint(noise), 0, 1023).sum(axis=0)
    more = replace(stretch, counts=stretch.counts * oversampling, oversampling=oversampling)
    health = check_health(with_counts(more, dead, 2, 1), layout=layout)
    assert codes(health) == [(code, "R2 C1")]
    assert not health.is_healthy


@pytest.mark.parametrize(
    ("factor", "found"),
    [(1.0, set()), (1e6, {"open", "faint"}), (1e-6, {"short"})],
    ids=["healthy", "open", "short"],
)
def test_health_check_with_floating_lines_reports_only_the_bad_pixel(
    factor: float, found: set[str]
) -> None:
    """Parallel paths can make an open pixel read faint; no other pixel is reported."""
    bare = replace(RIGID_LAYOUT, idle_lines="floating")
    rng = np.random.default_rng(4)
    for seed in range(6):
        rest_ohm = World(None, seed=seed).pixel_resistance_ohm(0.0)
        rest_ohm[2, 1] *= factor
        read = floating_readings_ohm(rest_ohm * rng.normal(1.0, 0.0015, (150, 4, 2)))
        volts, noise = ohm_to_volts(read, divider=bare.divider), rng.normal(0, 0.3, read.shape)
        counts = volts_to_counts(volts, divider=bare.divider, noise_counts=noise)
        health = check_health(replace(twin_rest(1)[0], counts=counts), layout=bare)
        assert {where for _, where in codes(health)} == ({"R2 C1"} if found else set())
        assert {code for code, _ in codes(health)} <= found


@pytest.mark.parametrize(
    ("pixels", "where"),
    [((2,), "row R2"), ((slice(None), 1), "column C1"), ((), "every pixel")],
    ids=["row", "column", "all"],
)
def test_health_check_reports_a_dead_line_as_one_finding(pixels: tuple, where: str) -> None:
    stretch, layout = twin_rest(1)
    assert codes(check_health(with_counts(stretch, 0, *pixels), layout=layout)) == [("open", where)]


def test_health_check_reports_an_open_pixel_in_the_lower_leg() -> None:
    layout = ArrayLayout(
        name="pair", rows=1, cols=2, finger_of_row=(0,), divider=Divider(taxel_leg="lower")
    )
    counts = np.random.default_rng(1).integers(700, 703, (60, 1, 2)).astype(np.int32)
    counts[:, 0, 1] = 1023
    rest = FrameColumns(time_s=np.arange(60) / 15.0, sequence=np.arange(60), counts=counts)
    assert codes(check_health(rest, layout=layout)) == [("open", "R0 C1")]


def test_health_check_reports_a_constant_pixel_among_noisy_pixels_as_stuck() -> None:
    """With noise far below one count, healthy pixels are constant."""
    stretch, layout = twin_rest(2)
    middle = int(np.median(stretch.counts[:, 1, 0]))
    health = check_health(with_counts(stretch, middle, 1, 0), layout=layout)
    assert codes(health) == [("stuck", "R1 C0")]
    assert check_health(with_counts(stretch, stretch.counts[0]), layout=layout).is_healthy


def dropouts() -> np.ndarray:
    factor = np.ones(150)
    factor[[30, 31, 80, 120]] = 1e7
    return factor


@pytest.mark.parametrize(
    ("code", "factor"),
    [
        ("noisy", np.random.default_rng(5).normal(1.0, 0.04, 150)),
        ("drifting", np.linspace(1.0, 0.93, 150)),
        ("loose", dropouts()),
        ("faint", np.full(150, 15.0)),
    ],
)
def test_health_check_reports_a_noisy_drifting_loose_or_faint_pixel(
    code: str, factor: np.ndarray
) -> None:
    stretch, layout = twin_rest(3)
    volts = ohm_to_volts(stretch.ohm(layout=layout)[:, 3, 0] * factor, divider=layout.divider)
    changed = with_counts(stretch, volts_to_counts(volts, divider=layout.divider), 3, 0)
    health = check_health(changed, layout=layout)
    assert codes(health) == [(code, "R3 C0")]
    if code == "noisy":
        assert health.pixels.noise_percent[3, 0] == pytest.approx(4.0, rel=0.2)


def test_health_check_reports_a_pixel_that_differs_from_its_calibration() -> None:
    """A change of all pixels is climate; a change of one pixel is a fault."""
    stretch, layout = twin_rest(7)
    known = 0.9 * stretch.rest_ohm(layout=layout)
    assert check_health(stretch, layout=layout, known_ohm=known).is_healthy
    known[0, 0] *= 0.5
    health = check_health(stretch, layout=layout, known_ohm=known)
    assert codes(health) == [("changed", "R0 C0")]


def test_health_check_of_a_touched_sensor_reports_unrest() -> None:
    """A load that begins, and one that was there before, seen from the calibrated rest values."""
    stretch, layout = twin_rest(8)
    begun = stretch.counts.copy()
    begun[75:] = np.minimum(begun[75:] * 2, 1000)
    known = 1.5 * stretch.rest_ohm(layout=layout)
    for health in (
        check_health(with_counts(stretch, begun), layout=layout),
        check_health(stretch, layout=layout, known_ohm=known),
    ):
        assert codes(health) == [("unrest", "sensor")]


def test_health_check_reports_each_link_fault_with_its_severity() -> None:
    stretch, layout = twin_rest(10)
    shaken = stretch.time_s + np.random.default_rng(2).uniform(0, 0.03, 150)
    health = check_health(
        replace(stretch, time_s=shaken),
        layout=layout,
        requested_hz=30.0,
        counters=LinkCounters(corrupt=5, late=2, restarts=1, drift_ppm=-7000.0),
    )
    found = {finding.code: finding.severity for finding in health.findings}
    faults = dict.fromkeys(("slow", "corrupt", "clock", "restarted"), Severity.FAULT)
    assert found == {**faults, "late": Severity.ADVICE, "jitter": Severity.ADVICE}


def test_health_check_recommends_a_resistor_for_the_range_measured_under_load() -> None:
    """The paper's 4.7 kohm with pixels down to 40 ohm, 9 counts from the end."""
    layout = ArrayLayout(name="one", rows=1, cols=4, finger_of_row=(0,))
    rng = np.random.default_rng(3)
    ohm = np.full((400, 1, 4), 12e3)
    ohm[200:] = 40.0
    volts = ohm_to_volts(ohm, divider=layout.divider)
    noise = rng.normal(0, 0.4, ohm.shape)
    counts = volts_to_counts(volts, divider=layout.divider, noise_counts=noise)
    whole = FrameColumns(time_s=np.arange(400) / 50.0, sequence=np.arange(400), counts=counts)
    health = check_health(whole.select_first(3.9), layout=layout, all_frames=whole)
    assert codes(health) == [("resistor", "4700 ohm")]
    assert not health.is_healthy
    assert 560 <= health.resistor.recommended_ohm <= 820


@pytest.mark.parametrize("level", ["lab", "field"])
def test_health_check_of_healthy_twins_reports_no_fault(level: str) -> None:
    faults = [
        (seed, found.code)
        for seed in range(12)
        for stretch, layout in [twin_rest(100 + seed, level, "soft" if seed % 2 else "rigid")]
        for found in check_health(stretch, layout=layout, requested_hz=RATE_HZ).findings
        if found.severity is Severity.FAULT
    ]
    assert faults == []


def read_with(actual: Divider, ohm: np.ndarray, *, seed: int = 6) -> FrameColumns:
    """Return frames of pixels with these resistances, shape (frames, 1, 2), and noise."""
    noise = np.random.default_rng(seed).normal(0.0, 0.6, ohm.shape)
    counts = volts_to_counts(ohm_to_volts(ohm, divider=actual), divider=actual, noise_counts=noise)
    number = np.arange(len(ohm))
    return FrameColumns(time_s=number / 30.0, sequence=number, counts=counts)


@pytest.mark.parametrize(("actual", "stated"), [("lower", "upper"), ("upper", "lower")])
@pytest.mark.parametrize("rest_ohm", [18e3, 6e3])
def test_health_check_names_the_leg_of_the_divider_before_the_resistor(
    actual: Literal["upper", "lower"], stated: Literal["upper", "lower"], rest_ohm: float
) -> None:
    right = Divider(reference_ohm=3.3e3, taxel_leg=actual)
    layout = ArrayLayout(name="pair", rows=1, cols=2, finger_of_row=(0,), divider=right)
    wrong = replace(layout, divider=replace(right, taxel_leg=stated))
    ohm = np.full((120, 1, 2), rest_ohm)
    ohm[70:100, 0, 1] /= 6.0
    pressed = read_with(right, ohm)
    rest = replace(
        pressed,
        **{name: getattr(pressed, name)[:60] for name in ("time_s", "sequence", "counts")},
    )
    found = check_health(rest, layout=wrong, all_frames=pressed)
    assert {code for code, _ in codes(found)} == {"leg"}
    assert not found.is_healthy
    assert "leg" not in dict(codes(check_health(rest, layout=layout, all_frames=pressed)))
    assert check_health(rest, layout=layout, all_frames=pressed).is_healthy


@pytest.mark.parametrize(("actual", "first"), [("lower", "leg"), ("upper", None)])
def test_health_check_at_rest_suspects_the_leg_first_if_the_resistor_suits_the_other(
    actual: Literal["upper", "lower"], first: str | None
) -> None:
    right = Divider(reference_ohm=4.7e3, taxel_leg=actual)
    layout = ArrayLayout(name="pair", rows=1, cols=2, finger_of_row=(0,))
    health = check_health(read_with(right, np.full((90, 1, 2), 21e3)), layout=layout)
    assert next((code for code, _ in codes(health)), None) == first
    assert health.is_healthy  # A press would tell.
