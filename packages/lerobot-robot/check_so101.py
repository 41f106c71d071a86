"""Check that LeRobot moves an SO-101's arm while palpate grasps on the same servo line, simulated.

Run `python packages/lerobot-robot/check_so101.py` in an environment with `lerobot[feetech]` and
`palpate[gripper]`. It starts `palpate demo so101` and runs `examples/so101.py`; it exits with 1
if the object was not held or the arm did not move.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "so101.py"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "palpate", "demo", "so101", "--out", folder]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as demo:
            try:
                assert demo.stdout is not None
                for line in iter(demo.stdout.readline, ""):
                    print(line, end="")
                    if line.startswith("SIMULATED"):
                        break
                done = subprocess.run(
                    [sys.executable, EXAMPLE, folder], capture_output=True, text=True, check=False
                )
            finally:
                demo.send_signal(signal.SIGINT)
    print(done.stdout, done.stderr, sep="", end="")
    raised = re.search(r"raised by (\d+) of 120 steps", done.stdout)
    if done.returncode or raised is None or int(raised[1]) < 60 or "held" not in done.stdout:
        sys.exit("BAD the object was not held, or the arm did not move")
    print("ok  held while the arm moved")


if __name__ == "__main__":
    main()
