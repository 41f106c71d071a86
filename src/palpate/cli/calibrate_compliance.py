"""`palpate calibrate compliance`: compliance of pads, fingers and servo; servo current."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from palpate.calibrate.guided import measure_block
from palpate.calibrate.servo_current import measure_current, measure_gear_friction
from palpate.calibrate.sheet_cell import SheetCell
from palpate.calibration import Calibration, join_currents
from palpate.cli.calibrate_bench import (
    load_earlier_calibration,
    open_block_bench,
    resolve_calibration_file,
)
from palpate.cli.options import CalibrationOption, JsonOption, RigOption, SeedOption, opt
from palpate.cli.output import print_json, print_message
from palpate.errors import InputError
from palpate.force.of_calibration import DWELL_S
from palpate.object.compliance import Compliance
from palpate.rig.bench import GuidedBench

#: Highest force of each closing, newtons, by a load cell and by the upper limit of the sheet, which
#: may read low on a rigid block; number of closings.
_UP_TO_N, _SHEET_UP_TO_N, _REPEATS = 15.0, 8.0, 3


def calibrate_compliance(
    block_mm: Annotated[
        float,
        opt("--block-mm MM", "Thickness of the rigid block, with its load cell if any."),
    ] = 40.0,
    rig: RigOption = "",
    out: CalibrationOption = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Close on a rigid block of known size to measure the gripper's own compliance.

    The force is that of a load cell, or of the calibrated sheet if the rig has none. With a load
    cell and a gripper that reports its motor current, the current is recorded with the force, then
    again with an empty gripper to measure the gear friction.

    Example: palpate calibrate compliance --block-mm 40 --out pad-3.json
    """
    path = resolve_calibration_file(rig, out)
    known = Calibration.load(path) if path.exists() else None
    with open_block_bench(rig, seed=seed, block_mm=block_mm, known=known) as guided:
        calibration = _measure(guided, block_mm=block_mm, rig=rig, out=path)
    block = calibration.block
    compliance = Compliance.fit(block.force_n, width_mm=block.width_mm, block_mm=block.block_mm)
    calibration.save(path)
    if as_json:
        print_json(
            {
                "file": str(path),
                "simulated": calibration.origin == "simulated",
                "readings": len(block.force_n),
                "fingers_mm_per_n": compliance.slope_mm_per_n,
                "pads_mm": float(sum(compliance.pad_mm)),
                "zero_mm": compliance.zero_mm,
                "residual_mm": compliance.residual_mm,
                "largest_force_n": compliance.largest_force_n,
                "current_readings": None
                if calibration.current is None
                else len(calibration.current.force_n),
            }
        )
        return
    simulated = " (simulated)" if calibration.origin == "simulated" else ""
    print(
        f"{path}{simulated}: {len(block.force_n)} closings up to {compliance.largest_force_n:.1f} N"
    )
    slope_mm_per_n, pads_mm = compliance.slope_mm_per_n, sum(compliance.pad_mm)
    print(f"compliance of fingers and servo {slope_mm_per_n:.3f} mm/N, pads {pads_mm:.2f} mm")
    print(f"width offset {compliance.zero_mm:+.2f} mm, residual {compliance.residual_mm:.3f} mm")
    if calibration.current is None:
        print("servo current: not reported by this gripper, or no load cell to compare it with")
    else:
        print(f"servo current: {len(calibration.current.force_n)} readings")


def _measure(guided: GuidedBench, *, block_mm: float, rig: str, out: Path) -> Calibration:
    """Close on the block to measure travel and current, then close the empty gripper."""
    bench = guided.bench
    limits = bench.gripper.limits
    if not limits.lowest < block_mm < limits.highest:
        raise InputError(
            f"--block-mm {block_mm:g}: outside the gripper's range of {limits.lowest:g} to "
            f"{limits.highest:g} mm; give the thickness in millimetres"
        )
    earlier = load_earlier_calibration(
        out, layout=bench.array.layout, simulated=guided.is_simulated
    )
    if earlier is None:
        raise InputError(
            f"{out} does not exist yet; run `palpate calibrate force --rig {rig} --out {out}` first"
        )
    guided.place_block()
    has_cell = not isinstance(bench.cell, SheetCell)
    # A law is not used beyond the forces that it was calibrated with.
    up_to_n = _UP_TO_N if has_cell else min(_SHEET_UP_TO_N, max(earlier.force.force_n))
    block = measure_block(
        bench,
        block_mm=block_mm,
        up_to_n=up_to_n,
        repeats=_REPEATS,
        dwell_s=DWELL_S,
        tell=print_message,
    )
    if has_cell:
        print_message(f"{_REPEATS} slow closings on the load cell, for the servo's current")
    # The current is evidence of the force beside the sheet only if something else measured it.
    current = measure_current(bench, up_to_n=_UP_TO_N, repeats=_REPEATS) if has_cell else None
    if current is not None:
        guided.remove_object()
        empty = measure_gear_friction(bench)
        current = current if empty is None else join_currents(current, empty)
    return replace(earlier, block=block, current=current)
