"""`palpate pattern`: files for a vinyl cutter, from a few numbers in millimetres."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from palpate.commands import pattern_options as option
from palpate.commands.options import JsonOption
from palpate.commands.pattern_options import Shape
from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.fabrication.design import SensorDesign
    from palpate.fabrication.pattern import Pattern
    from palpate.fabrication.rest_resistance import RestExpectation


def pattern(
    out: option.FolderOption,
    preset: option.PresetOption = "paper-2x2",
    name: option.NameOption = None,
    rows: option.RowsOption = None,
    cols: option.ColsOption = None,
    pixel: option.PixelOption = None,
    shape: option.ShapeOption = "rectangle",
    corner: option.CornerOption = 1.5,
    gap: option.GapOption = None,
    overhang: option.OverhangOption = None,
    trace: option.TraceOption = None,
    pad: option.PadOption = None,
    pad_pitch: option.PadPitchOption = None,
    tail: option.TailOption = None,
    margin: option.MarginOption = None,
    width: option.WidthOption = None,
    min_feature: option.MinFeatureOption = 1.0,
    min_gap: option.MinGapOption = 0.5,
    sheet: option.SheetOption = "296x298",
    measured_ohm: option.MeasuredOhmOption = None,
    measured_mm2: option.MeasuredAreaOption = None,
    resistivity: option.ResistivityOption = 500.0,
    thickness: option.ThicknessOption = 0.1,
    dxf: option.DxfOption = False,
    as_json: JsonOption = False,
) -> None:
    """Draw the cut files of a sensor: base, copper, Velostat, copper, cover. Lengths in mm.

    Example: palpate pattern --preset paper-3x2 --out sensor
    """
    from palpate.commands.pattern_report import print_pattern, summary, write_files

    changes = {
        "name": name,
        "rows": rows,
        "cols": cols,
        "gap_mm": gap,
        "overhang_mm": overhang,
        "trace_mm": trace,
        "pad_pitch_mm": pad_pitch,
        "tail_mm": tail,
        "margin_mm": margin,
        "substrate_width_mm": width,
    }
    if pixel is not None:
        changes["pixel_width_mm"], changes["pixel_height_mm"] = _size(pixel, option="--pixel")
    if pad is not None:
        changes["pad_width_mm"], changes["pad_length_mm"] = _size(pad, option="--pad")
    design = _design(preset, changes={k: v for k, v in changes.items() if v is not None})
    design = replace(design, corner_mm=_corner_mm(design, shape=shape, corner_mm=corner))
    drawn = _drawn(design, sheet=sheet, feature_mm=min_feature, gap_mm=min_gap)
    expected = _expectation(
        drawn,
        measured_ohm=measured_ohm,
        measured_mm2=measured_mm2,
        resistivity=resistivity,
        thickness=thickness,
    )
    files = write_files(drawn, out, dxf=dxf)
    if as_json:
        print(json.dumps(summary(drawn, expected, files), indent=1))
    else:
        print_pattern(drawn, expected, files)


def _drawn(design: SensorDesign, *, sheet: str, feature_mm: float, gap_mm: float) -> Pattern:
    """Lay the design out, or refuse what can't be cut."""
    from palpate.fabrication.design import Cutter
    from palpate.fabrication.pattern import lay_out
    from palpate.fabrication.refusals import check_design, check_pattern

    width_mm, height_mm = _size(sheet, option="--sheet")
    cutter = Cutter(width_mm=width_mm, height_mm=height_mm, feature_mm=feature_mm, gap_mm=gap_mm)
    check_design(design, cutter=cutter)
    drawn = lay_out(design)
    check_pattern(drawn, cutter=cutter)
    return drawn


def _design(preset: str, *, changes: dict[str, Any]) -> SensorDesign:
    from palpate.fabrication.design import PRESETS

    if preset not in PRESETS:
        raise InputError(f"--preset {preset}: there are {', '.join(PRESETS)}")
    if not re.fullmatch(r"[\w.-]+", changes.get("name", preset)):
        raise InputError(f"--name {changes['name']!r}: use letters, digits, '-', '_' and '.'")
    return replace(PRESETS[preset], **changes)


def _corner_mm(design: SensorDesign, *, shape: Shape, corner_mm: float) -> float:
    if shape == "rectangle":
        return 0.0
    if shape == "rounded":
        return corner_mm
    if design.pixel_width_mm != design.pixel_height_mm:
        raise InputError(
            f"--shape circle with --pixel {design.pixel_width_mm:g}x{design.pixel_height_mm:g}: "
            "a circle is as wide as high; give one number"
        )
    return design.pixel_width_mm / 2


def _size(text: str, *, option: str) -> tuple[float, float]:
    """Return width and height of ``"7"`` or ``"7x9"``.

    >>> _size("7x9.5", option="--pixel"), _size("7", option="--pixel")
    ((7.0, 9.5), (7.0, 7.0))
    """
    try:
        numbers = [float(part) for part in text.lower().split("x")]
    except ValueError:
        numbers = []
    if len(numbers) == 1:
        numbers *= 2
    if len(numbers) != 2:
        raise InputError(f"{option} {text}: give millimetres, such as 7 or 7x9")
    return numbers[0], numbers[1]


def _expectation(
    drawn: Pattern,
    *,
    measured_ohm: float | None,
    measured_mm2: float | None,
    resistivity: float,
    thickness: float,
) -> RestExpectation:
    from palpate.fabrication.rest_resistance import from_measurement, from_sheet

    if measured_ohm is None:
        if measured_mm2 is not None:
            raise InputError("--measured-mm2 needs --measured-ohm too")
        return from_sheet(volume_ohm_cm=resistivity, thickness_mm=thickness)
    contact = drawn.pixels[0].contact
    area_mm2 = contact.width * contact.height if measured_mm2 is None else measured_mm2
    return from_measurement(ohm=measured_ohm, contact_mm2=area_mm2)
