"""Commands ended by signals, a closed terminal, and as the first process of a container."""

from __future__ import annotations

import importlib
import os
import pty
import shutil
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from tests.fixtures import skip

from palpate.errors import PalpateError
from palpate.gripper.interface import GripperState
from palpate.recording import RecordingReader
from palpate.sensor.array import Frame
from palpate.stop_signals import handle_stop_signals, interrupt

pytestmark = pytest.mark.slow

COMMAND = [sys.executable, "-m", "palpate"]
GRASP = [*COMMAND, "grasp", "--rig", "sim-rigid", "--seed", "1", "--record", "run.mcap"]
ENDLESS = [*COMMAND, "record", "run.mcap", "--rig", "sim-rigid", "--duration", "1e9"]

#: The simulated grasp takes a second, and may be held before the signal on a busy machine.
STATUSES = {"grasp": (130, 0), "record": (130,)}


def is_intact(path: Path) -> bool:
    # A grasp stopped before its first frame has none.
    with RecordingReader(path) as reader:
        return reader.state.is_intact


@pytest.fixture(autouse=True)
def hangup_by_default() -> Iterator[None]:
    """Start commands with the default action of a hangup, also if the tests run under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


def wait_for(is_done: Callable[[], object]) -> None:
    until_s = time.monotonic() + 30
    while not is_done():
        assert time.monotonic() < until_s
        time.sleep(0.03)


def has_frames(path: Path) -> bool:
    with warnings.catch_warnings(), suppress(PalpateError), RecordingReader(path) as reader:
        warnings.simplefilter("ignore")  # The file is not finished.
        return any(isinstance(message, Frame) for message in reader.messages())
    return False


def start(command: list[str], folder: Path, **options: object) -> subprocess.Popen[str]:
    """Start a command and wait until its recording has data."""
    process = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )
    wait_for(lambda: process.poll() is not None or has_frames(folder / "run.mcap"))
    return process


@pytest.mark.parametrize(
    ("command", "number"),
    [(GRASP, signal.SIGTERM), (GRASP, signal.SIGINT), (ENDLESS, signal.SIGHUP)],
)
def test_repeated_signals_end_a_command_with_a_complete_file(
    command: list[str], number: int, tmp_path: Path
) -> None:
    process = start(command, tmp_path)
    until_s = time.monotonic() + 60
    while process.poll() is None:
        assert time.monotonic() < until_s
        process.send_signal(number)
        time.sleep(0.002)
    error = process.communicate()[1]
    assert "Traceback" not in error
    assert process.returncode in STATUSES[command[3]]
    with RecordingReader(tmp_path / "run.mcap") as reader:
        kinds = [type(message) for message in reader.messages()]
        info, state = reader.info, reader.state
    assert state.is_intact
    assert (info.origin, info.rig) == ("twin", "sim-rigid")
    assert info.calibration is not None
    if command is ENDLESS:
        assert kinds.count(Frame) == kinds.count(GripperState) > 0
        assert info.gripper is None, "without a grasp, a replay makes no decisions"


def test_nohup_grasp_continues(tmp_path: Path) -> None:
    process = start(["nohup", *GRASP], tmp_path)
    process.send_signal(signal.SIGHUP)
    process.communicate()
    assert process.returncode == 0
    assert is_intact(tmp_path / "run.mcap")


def test_closed_terminal_leaves_a_complete_file(tmp_path: Path) -> None:
    """Afterwards, standard output and error can't be written."""
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(tmp_path)
        os.execv(GRASP[0], GRASP)
    path = tmp_path / "run.mcap"
    wait_for(lambda: has_frames(path))
    os.close(terminal)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) in STATUSES["grasp"]
    assert is_intact(path)


@pytest.mark.parametrize("verb", ["grasp", "live"])
def test_first_process_of_a_container_ends_on_sigterm(verb: str, tmp_path: Path) -> None:
    """The system ignores a signal without handler to the first process."""
    isolate = ["unshare", "--pid", "--fork", "--kill-child=KILL"]
    if (
        shutil.which("unshare") is None
        or subprocess.run([*isolate, "true"], check=False).returncode
    ):
        skip("needs the right to create a process namespace")
    options = {"grasp": GRASP, "live": [*COMMAND, "live", "--rig", "sim-rigid"]}[verb]
    process = subprocess.Popen(
        [*isolate, *options], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    wait_for(children.read_text)
    first = int(children.read_text())
    if verb == "grasp":
        wait_for(lambda: has_frames(tmp_path / "run.mcap"))
    else:
        # Handlers are installed when the signal is caught.
        wait_for(lambda: is_caught(first, signal.SIGTERM))
        time.sleep(0.5)
    os.kill(first, signal.SIGTERM)
    assert process.wait(timeout=30) in STATUSES.get(verb, (130,))
    assert b"Traceback" not in process.communicate()[1]


def test_ctrl_c_ends_live_while_it_waits_for_a_silent_board() -> None:
    board, port = pty.openpty()
    try:
        with subprocess.Popen(
            [*COMMAND, "live", "--port", os.ttyname(port)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        ) as process:
            wait_for(lambda: os.ttyname(port) in open_files(process.pid))
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=30) == 130
    finally:
        os.close(board)
        os.close(port)


def open_files(process: int) -> set[str]:
    found = set()
    for path in Path(f"/proc/{process}/fd").iterdir():
        with suppress(OSError):
            found.add(os.readlink(path))
    return found


def is_caught(process: int, number: int) -> bool:
    status = Path(f"/proc/{process}/status").read_text()
    caught = int(status.split("SigCgt:")[1].split()[0], 16)
    return bool(caught >> (number - 1) & 1)


def test_interrupt_during_an_import_is_raised_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Libraries can lose an exception that is raised inside of their imports."""
    lines = ["import signal", "try:", "    signal.raise_signal(signal.SIGTERM)"]
    lines += ["except BaseException:", "    pass", "is_complete = True"]
    (tmp_path / "interrupted_library.py").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("palpate.stop_signals._repeat_until_s", 0.0)
    with handle_stop_signals(interrupt):
        assert importlib.import_module("interrupted_library").is_complete
        with pytest.raises(KeyboardInterrupt):
            time.sleep(10.0)
