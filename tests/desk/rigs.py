"""The rig's folder as its user has it: rig file, calibration, own driver."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

from tests.contract.hands import CLOSED_TICK, JAW, JAW_LIMITS, TRAVEL
from tests.desk.world import SHEET_SEED, Desk, draw_desk_object, layout_of, sheet_layout

from palpate.calibration import Calibration
from palpate.twin.rig import CALIBRATION_SEED_OFFSET, calibrate_world
from palpate.twin.world import World

#: Hands that report their motor's current.
_WITH_CURRENT = ("dynamixel", "feetech")


@cache
def calibrate(board: str) -> Calibration:
    """Return the calibration of the desk's sheet and hand, as read by a board."""
    world = World(
        None,
        seed=SHEET_SEED + CALIBRATION_SEED_OFFSET,
        sheet_seed=SHEET_SEED,
        layout=sheet_layout(board),
    )
    calibration = calibrate_world(
        world,
        seed=SHEET_SEED,
        apart_from=draw_desk_object(0).name,
        sensor_id=f"desk-{board}",
    )
    return replace(calibration, layout=layout_of(board))


def write_rig(folder: Path, desk: Desk, *, ports: dict[str, str | None]) -> None:
    """Write rig.toml and what it names into a folder."""
    calibration = calibrate(desk.board)
    if desk.hand not in _WITH_CURRENT:
        calibration = replace(calibration, current=None)
    calibration.save(folder / "calibration.json")
    lines = ['calibration = "calibration.json"', "", "[array]"]
    board = f'port = "{ports["board"]}"'
    if desk.board == "firmware":
        lines += [
            'open = "palpate.sensor.board_array:open_board"',
            board,
            'layout = "rigid-2x2"',
            f"rate_hz = {desk.rate_hz}",
        ]
        if desk.hand == "servo":
            lines += ["servo = true"]
    elif desk.board == "text":
        lines += [
            'open = "palpate.sensor.text_lines:open_board"',
            board,
            'layout = "rigid-2x2"',
        ]
    else:
        lines += ['open = "palpate.sensor.flexitac:open_board"', board]
    hand = f'port = "{ports["hand"]}"'
    lines += ["", "[gripper]"]
    if desk.hand == "dynamixel":
        lines += [
            'open = "palpate.gripper.dynamixel:open_gripper"',
            hand,
            # Narrower than by default, because a squeezed object of 32 mm is.
            "lowest_mm = 22.0",
        ]
    elif desk.hand == "feetech":
        lines += [
            'open = "palpate.gripper.feetech:open_gripper"',
            hand,
            f"jaw_mm = {JAW.jaw_mm}",
            f"closed_tick = {CLOSED_TICK}",
            f"lowest_mm = {JAW_LIMITS.lowest}",
            f"highest_mm = {JAW_LIMITS.highest}",
        ]
    elif desk.hand == "servo":
        lines += [
            'open = "palpate.gripper.hobby_servo:open_gripper"',
            f"open_us = {TRAVEL.open_us}",
            f"closed_us = {TRAVEL.closed_us}",
            f"open_mm = {TRAVEL.open_mm}",
            f"closed_mm = {TRAVEL.closed_mm}",
        ]
    else:
        lines += ['open = "own_hand:open_hand"', hand]
        shutil.copy(Path(__file__).with_name("own_hand.py"), folder)
    (folder / "rig.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
