"""The page about the SO-101, with the simulated arm in another process, in real time.

On a busy computer the simulated servo can be later than the driver accepts, as a servo with a loose
cable: a grasp then ends as a gripper fault, and is tried again.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import pytest
from tests.pages import ROOT, blocks, run_line
from tests.so101 import run_so101

import palpate
from palpate.demo.so101 import simulate_so101
from palpate.gripper import sts_series as sts
from palpate.gripper.packets import PROTOCOL_1
from palpate.gripper.servo_line import ServoLine

pytestmark = pytest.mark.slow
RAISE_TICKS, ATTEMPTS = 200, 4
#: Exit status of a grasp with a gripper fault.
FAULT = 3


def test_commands_and_code_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lines = [
        line for kind, _, text in blocks("so101") if kind == "sh" for line in text.splitlines()
    ]
    code = [text for kind, _, text in blocks("so101") if kind == "python"]
    assert lines
    assert code
    with run_so101(tmp_path):
        for line in lines:
            statuses = []
            while len(statuses) < ATTEMPTS and statuses[-1:] in ([], [FAULT]):
                statuses.append(run_line(line))
            assert statuses[-1] == 0, statuses
        for text in code:
            exec(compile(text, "docs/so101.md", "exec", dont_inherit=True), {})
    # What the page shows from the demo is what it prints.
    assert "SIMULATED SO-101: servos 1 to 6 on " in (ROOT / "docs" / "so101.md").read_text()


def test_arm_moves_while_palpate_holds_on_the_same_line(tmp_path: Path) -> None:
    with run_so101(tmp_path) as folder:
        # Another program's port: that of LeRobot, which moves the arm.
        lift = ServoLine(str(folder / "arm"), servo_id=2, baud=1_000_000, packets=PROTOCOL_1)
        lift.write(sts.TORQUE_ENABLE, 1)
        start = lift.read(sts.PRESENT_POSITION)
        for _ in range(ATTEMPTS):
            forces_n, outcome = [], "gripper_fault"
            with palpate.open_rig(str(folder / "simulated.toml")) as rig:
                grip = rig.grasp(target_force_n=2.0)
                for step in range(40):
                    if not grip.is_holding:
                        break
                    lift.write(sts.GOAL_POSITION, start - RAISE_TICKS * step // 39)
                    forces_n.append(rig.read().force_n.value)
                moved = start - lift.read(sts.PRESENT_POSITION)
                outcome = grip.release().outcome
            if outcome != "gripper_fault":
                break
            lift.write(sts.GOAL_POSITION, start)
        lift.close()
    assert outcome == "held"
    assert len(forces_n) == 40
    assert moved > 0.8 * RAISE_TICKS
    assert all(1.0 < force_n < 3.5 for force_n in forces_n)
    # The ports of a demo that has ended are gone.
    assert {path.name for path in folder.iterdir()} == {
        *("simulated.toml", "calibration.json", "lerobot.json")
    }


def test_second_demo_in_a_folder_is_refused_and_leaves_the_first(tmp_path: Path) -> None:
    with run_so101(tmp_path) as folder:
        second = subprocess.run(
            [sys.executable, "-m", "palpate", "demo", "so101"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert second.returncode == 2
        assert len(second.stderr.splitlines()) == 1
        assert "demo-so101" in second.stderr
        assert all((folder / name).exists() for name in ("hand", "arm", "sensor"))
        lift = ServoLine(str(folder / "arm"), servo_id=2, baud=1_000_000, packets=PROTOCOL_1)
        assert lift.ping() == 0
        lift.close()


def test_running_demo_shows_the_true_force(tmp_path: Path) -> None:
    shown: list[str] = []

    def show(line: str) -> None:
        shown.append(line)
        raise KeyboardInterrupt

    def squeeze() -> None:
        jaw = ServoLine(str(tmp_path / "hand"), servo_id=6, baud=1_000_000, packets=PROTOCOL_1)
        jaw.write(sts.TORQUE_ENABLE, 1)
        jaw.write(sts.GOAL_POSITION, jaw.read(sts.PRESENT_POSITION) - 440)
        jaw.close()

    with simulate_so101(tmp_path) as robot:
        threading.Thread(target=squeeze).start()
        with pytest.raises(KeyboardInterrupt):
            robot.run(show=show)
        force_n, width_mm = robot.truth()
    assert force_n > 0.0
    assert shown == [f"SIMULATED truth: {force_n:.2f} N, {width_mm:.1f} mm between the pads"]
