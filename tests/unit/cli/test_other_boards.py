"""Boards of other makers: check, calibration, live forces and recordings."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from tests.commands import run_palpate
from tests.other_boards import FLEXITAC, PADS, SendingBoard, SendingClock, line_of, marked

from palpate.clock import RealClock
from palpate.sensor.array import PressureArray
from palpate.sensor.flexitac import FlexitacDecoder
from palpate.sensor.text_lines import LineDecoder

_BOARDS: list[SendingBoard] = []


def open_text() -> PressureArray:
    return _BOARDS[-1].array(LineDecoder(PADS))


def open_flexitac() -> PressureArray:
    return _BOARDS[-1].array(FlexitacDecoder(rows=12))


class Desk:
    """A board, its clock and a rig file that opens it."""

    def __init__(
        self, board: SendingBoard, *, folder: Path, opener: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        self.board, self.clock, self.folder = board, board.clock, folder
        self.capsys = capsys
        self.rig = folder / "rig.toml"
        self.rig.write_text(f'calibration = "pad.json"\n[array]\nopen = "{__name__}:{opener}"\n')

    def run(self, *words: object, status: int = 0) -> str:
        """Run a command on the rig; return its standard output."""
        arguments = [*map(str, words), "--rig", str(self.rig)]
        assert run_palpate(*arguments) == status
        printed, self.errors = self.capsys.readouterr()
        return printed

    def schedule_press(self, delay_s: float, *, load_n: float) -> None:
        self.board.loads_n[self.board.sent + round(delay_s / self.board.period_s)] = load_n

    def lay(self, load_n: float) -> None:
        self.board.sheet.lay(load_n, now_s=self.clock.now_s())


@pytest.fixture(params=["open_text", "open_flexitac"])
def desk(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Desk]:
    clock = SendingClock(in_a_hurry=True)
    monkeypatch.setattr(RealClock, "now_s", lambda _: clock.now_s())
    monkeypatch.setattr(RealClock, "sleep_s", lambda _, duration_s: clock.sleep_s(duration_s))
    layout, encode = (PADS, line_of) if request.param == "open_text" else (FLEXITAC, marked)
    _BOARDS.append(SendingBoard(clock, layout=layout, encode=encode, rate_hz=25.0))
    yield Desk(_BOARDS[-1], folder=tmp_path, opener=request.param, capsys=capsys)
    clock.close()
    _BOARDS.clear()


@pytest.mark.slow
def test_other_board_is_calibrated_to_newtons(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    """Doctor, rest, three weights, live force, a recording and its settled value."""
    health = json.loads(desk.run("doctor", "--json"))
    assert health["healthy"], health["findings"]
    assert (health["frames_lost"], health["corrupt"]) == (0, 0)
    desk.run("calibrate", "rest", "--duration", "2")
    prompts: list[str] = []

    def place_weight(text: str, **_: object) -> str:
        prompts.append(text)
        desk.lay(float(re.search(r"[\d.]+", text).group()))  # type: ignore[union-attr]
        return ""

    monkeypatch.setattr(typer, "prompt", place_weight)
    loads = desk.folder / "loads.csv"
    loads.write_text("load_n\n1.5\n4\n9\n")
    desk.run("calibrate", "force", "--loads", str(loads))
    assert len(prompts) == 3
    desk.lay(0.0)
    desk.clock.sleep_s(30.0)
    desk.schedule_press(4.0, load_n=2.5)
    shown = desk.run("live", "--force", "--duration", "8")
    found = re.findall(r"force now (\S+) N \((\S+) to (\S+), 90%\)", shown)
    value, low, high = map(float, found[-1])
    assert low < 2.5 < high
    assert value == pytest.approx(2.5, rel=0.3)
    desk.lay(0.0)
    desk.clock.sleep_s(30.0)
    desk.schedule_press(2.0, load_n=5.0)
    held = desk.folder / "held.mcap"
    desk.run("record", held, "--duration", "25")
    arguments = ["settle", str(held), "--cutoff", "2.5", "--json"]
    assert run_palpate(*arguments) == 0
    rows = json.loads(desk.capsys.readouterr().out)["rows"]
    (mean,) = [row for row in rows if (row["channel"], row["method"]) == ("mean", "relaxation")]
    assert mean["low"] < mean["predicted"] < mean["high"]
    # One step of the 8-bit counts is 6 % of a pixel at rest.
    assert abs(mean["error_percent"]) < 15.0
    arguments = ["force", str(held), "--calibration", str(desk.folder / "pad.json"), "--json"]
    assert run_palpate(*arguments) == 0
    (sensor,) = json.loads(desk.capsys.readouterr().out)["sensors"]
    strongest = max(sensor["contacts"], key=lambda contact: contact["low_n"])
    assert strongest["low_n"] < 5.0 < strongest["high_n"]
