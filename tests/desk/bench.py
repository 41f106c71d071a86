"""Grasps on the desk: one run of the installed product with one world, and what became of it."""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tests.desk.rigs import write_rig
from tests.desk.world import LOG, Desk, Report

#: The ways in which a guard reads (`user_guard`).
GUARDS = ("frame", "second", "pause", "thread")
_ROOT = Path(__file__).resolve().parents[2]
_PALPATE = Path(sys.executable).with_name("palpate")
#: No grasp takes longer; the product's own limit is shorter.
_GRASP_S, _GUARD_S, _WORLD_S = 90.0, 240.0, 20.0
#: A force that counts as contact.
_TOUCH_N = 0.02
#: The guard of `user_guard`: stops above this true force are too late, below the other too early.
GUARD_N, GUARD_LEAST_N = 3.3, 0.3
#: The force at the stop is the largest within this time of it.
_STOP_S = 0.1
#: The fingers are open again.
_OPEN_MM = 70.0


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run. `use`: "grasp" (command), "python", or "frame", "second", "pause" (guards)."""

    use: str
    board: str
    rate_hz: float
    hand: str
    busy: int = 0
    reply_s: float = 0.001
    burst_s: float = 0.0
    index: int = 0

    @property
    def seed(self) -> int:
        """Seed of the object and the noise, from the name of the pair and the number of the run."""
        return (
            zlib.crc32(f"{self.board} {self.rate_hz:g} {self.hand}".encode()) % 10**6 + self.index
        )

    @property
    def name(self) -> str:
        """The case in a row of the table."""
        return f"{self.board} {self.rate_hz:g} Hz"


@dataclass(frozen=True, kw_only=True)
class Run:
    """What became of a case; times in seconds.

    `reason`: why it failed; empty if it passed. `touch_s`: from the start of the command to the
    contact, from the world's log. `answer_s`: from the contact to the answer. `age_s`: largest age
    of a frame, according to the result. `peak_n`: largest true force; for a guard, at the
    stop.
    """

    case: Case
    reason: str
    outcome: str
    touch_s: float | None
    answer_s: float | None
    age_s: float | None
    peak_n: float
    total_s: float
    world: Report

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return asdict(self)


class WorldProcess:
    """A running world, and its folder with the rig of its user."""

    def __init__(self, desk: Desk, folder: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.desk.world", desk.as_text()],
            cwd=_ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._log = Path(desk.log)
        ports = self._read()
        write_rig(folder, desk, ports=ports)

    def ask(self, line: str) -> Any:
        """Send a line and return the answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(line.encode() + b"\n")
        self._process.stdin.flush()
        return self._read()

    def place(self, seed: int) -> None:
        """Replace the object; the hand is open."""
        if (answer := self.ask(f"place {seed}")) != "placed":
            raise RuntimeError(answer)

    def report(self) -> Report:
        """Return the report about the present object."""
        report: Report = self.ask("report")
        return report

    def close(self) -> None:
        """End the process, whatever its state."""
        self._process.kill()
        self._process.communicate()

    def read_log(self) -> np.ndarray[Any, Any]:
        """Return the records of the log up to the last report."""
        return np.fromfile(self._log, dtype=LOG)

    def _read(self) -> Any:
        assert self._process.stdout is not None
        if not select.select([self._process.stdout], [], [], _WORLD_S)[0]:
            raise TimeoutError("the world does not answer")
        return json.loads(self._process.stdout.readline())


@contextmanager
def open_world(case: Case) -> Iterator[tuple[WorldProcess, Path]]:
    """Run the world of a case in a fresh folder."""
    with tempfile.TemporaryDirectory(prefix="palpate-desk-") as name:
        folder = Path(name)
        desk = Desk(
            board=case.board,
            rate_hz=case.rate_hz,
            hand=case.hand,
            seed=case.seed,
            reply_s=case.reply_s,
            burst_s=case.burst_s,
            log=str(folder / "world.log"),
        )
        world = WorldProcess(desk, folder)
        try:
            yield world, folder
        finally:
            world.close()


def _environment(folder: Path) -> dict[str, str]:
    """Return the environment of a user whose own driver can be imported."""
    paths = [str(folder), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


def run_grasp(case: Case, *, world: WorldProcess, folder: Path) -> Run:
    """Grasp once with the installed command."""
    begin_s = time.monotonic()
    printed = folder / "result.json"
    with (
        printed.open("w", encoding="utf-8") as output,
        subprocess.Popen(
            [_PALPATE, "grasp", "--rig", "rig.toml", "--json"],
            cwd=folder,
            env=_environment(folder),
            stdout=output,
            stderr=subprocess.PIPE,
            text=True,
        ) as command,
    ):
        try:
            _, errors = command.communicate(timeout=_GRASP_S)
        except subprocess.TimeoutExpired:
            command.kill()
            _, errors = command.communicate()
            errors += f"no end after {_GRASP_S:g} s"
    total_s = time.monotonic() - begin_s
    try:
        document = json.loads(printed.read_text(encoding="utf-8"))
    except ValueError:
        document = {"outcome": f"exit status {command.returncode}", "faults": [errors.strip()]}
    return _judge(case, document, begin_s=begin_s, total_s=total_s, world=world)


def _judge(
    case: Case,
    document: dict[str, Any],
    *,
    begin_s: float,
    total_s: float,
    world: WorldProcess,
) -> Run:
    report, log = world.report(), world.read_log()
    outcome = document["outcome"]
    reason = "" if outcome == "held" else "; ".join(document["faults"]) or outcome
    if not reason and report["peak_n"] < _TOUCH_N:
        reason = "held, but nothing was touched"
    if not reason and report["width_mm"] < _OPEN_MM:
        reason = f"the hand is left at {report['width_mm']:.1f} mm"
    touching = log["monotonic_s"][log["force_n"] > _TOUCH_N]
    touching = touching[touching > begin_s]
    moments = {moment["name"]: moment["time_s"] for moment in document.get("moments", ())}
    answer_s = None
    if {"contact", "answer"} <= moments.keys():
        answer_s = moments["answer"] - moments["contact"]
    return Run(
        case=case,
        reason=reason,
        outcome=outcome,
        touch_s=float(touching[0]) - begin_s if touching.size else None,
        answer_s=answer_s,
        age_s=document.get("largest_frame_age_s"),
        peak_n=report["peak_n"],
        total_s=total_s,
        world=report,
    )


class Script:
    """A running script of a user, in the folder of its rig."""

    def __init__(self, name: str, *arguments: str, folder: Path) -> None:
        self._errors = (folder / "errors.txt").open("w+", encoding="utf-8")
        self._process = subprocess.Popen(
            [sys.executable, Path(__file__).with_name(name), *arguments],
            cwd=folder,
            env=_environment(folder),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
        )

    def ask(self, line: str, *, timeout_s: float) -> dict[str, Any]:
        """Send a line; return the answer, or the outcome that the script has failed."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(BrokenPipeError):
            self._process.stdin.write(line.encode() + b"\n")
            self._process.stdin.flush()
        answer = b""
        if select.select([self._process.stdout], [], [], timeout_s)[0]:
            answer = self._process.stdout.readline()
        if not answer:
            self.close()
            self._errors.seek(0)
            lines = self._errors.read().strip().splitlines()
            return {"outcome": "script failed", "faults": lines[-1:] or ["no answer"]}
        document: dict[str, Any] = json.loads(answer)
        return document

    def close(self) -> None:
        """End the script, whatever its state."""
        self._process.kill()
        self._process.communicate()


def run_guard(case: Case) -> Run:
    """Close the hand with a user's script that stops at 3 N."""
    with open_world(case) as (world, folder):
        begin_s = time.monotonic()
        script = Script("user_guard.py", case.use, folder=folder)
        document = script.ask("", timeout_s=_GUARD_S)
        total_s = time.monotonic() - begin_s
        time.sleep(0.2)
        report = world.report()
        script.close()
        log = world.read_log()
        reason, stop_n = "; ".join(document.get("faults", ())), report["peak_n"]
        if not reason:
            at_stop = np.abs(log["monotonic_s"] - document["stop_s"]) < _STOP_S
            stop_n = float(log["force_n"][at_stop].max())
            stopped = f"at a true {stop_n:.2f} N, read as at most {document['high_n']:.2f} N"
            if stop_n > GUARD_N:
                reason = f"stopped too late: {stopped}"
            elif stop_n < GUARD_LEAST_N:
                reason = f"stopped before the contact: {stopped}"
        return Run(
            case=case,
            reason=reason,
            outcome=document.get("outcome", "stopped"),
            touch_s=None,
            answer_s=None,
            age_s=document.get("age_s"),
            peak_n=stop_n,
            total_s=total_s,
            world=report,
        )


def run_cases(cases: Sequence[Case]) -> Iterator[Run]:
    """Run the cases of one pair of board and hand, whose `use` is equal.

    A desk is used for one object after another until a grasp fails; the next has a new one.
    """
    left = list(cases)
    while left:
        for run in _run_on_one_desk(tuple(left)):
            left.remove(run.case)
            yield run


def _keep(folder: Path, case: Case) -> None:
    """Keep the folder of a failed case in $PALPATE_DESK_KEEP, if given."""
    if (kept := os.environ.get("PALPATE_DESK_KEEP")) is not None:
        name = f"{case.use}-{case.board}-{case.rate_hz:g}-{case.hand}-{case.busy}-{case.index}"
        shutil.copytree(folder, Path(kept) / name, dirs_exist_ok=True)


def _run_on_one_desk(cases: Sequence[Case]) -> Iterator[Run]:
    if cases[0].use in GUARDS:
        yield run_guard(cases[0])
        return
    with open_world(cases[0]) as (world, folder), ExitStack() as stack:
        script = None
        if cases[0].use == "python":
            script = stack.enter_context(closing(Script("user_grasp.py", folder=folder)))
        for case in cases:
            if case is not cases[0]:
                world.place(case.seed)
            if script is None:
                run = run_grasp(case, world=world, folder=folder)
            else:
                begin_s = time.monotonic()
                document = script.ask("", timeout_s=_GRASP_S)
                total_s = time.monotonic() - begin_s
                run = _judge(case, document, begin_s=begin_s, total_s=total_s, world=world)
            yield run
            if run.reason:
                _keep(folder, case)
                return
