"""`palpate flash` with a substitute for avrdude, and a board on a pseudo-terminal."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from tests.commands import Command
from tests.fixtures import skip

from palpate.cli.flash import explain_failure
from palpate.errors import DeviceNotFoundError
from palpate.firmware_image import IMAGES, image_path
from palpate_studies.benchmarks.pty_board import run_board, run_on_port

HEX = ":100000000C9434000C943E000C943E000C943E0082\n:00000001FF\n"


@pytest.fixture
def port() -> Iterator[str]:
    """Return the port of a board that answers `Identify`."""
    with run_on_port(partial(run_board, rate_hz=100.0)) as (port, _):
        yield port


@pytest.fixture
def image(tmp_path: Path) -> Path:
    path = tmp_path / "some.hex"
    path.write_text(HEX)
    return path


def install_avrdude(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *, output: str, status: int
) -> Path:
    """Put a program `avrdude` on the PATH that records its arguments; return their file."""
    log = folder / "arguments"
    program = folder / "bin" / "avrdude"
    program.parent.mkdir()
    program.write_text(
        f'#!/bin/sh\nprintf "%s\\n" "$@" > {log}\necho "{output}" >&2\nexit {status}\n'
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:/bin:/usr/bin")
    return log


@pytest.mark.slow
def test_flash_runs_avrdude_then_queries_the_board(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, port: str, image: Path, palpate: Command
) -> None:
    log = install_avrdude(tmp_path, monkeypatch, output="avrdude done. Thank you.", status=0)
    shown = palpate("flash", "--port", port, "--image", image).out
    arguments = log.read_text().split()
    assert arguments[:6] == ["-p", "atmega2560", "-c", "wiring", "-P", port]
    assert arguments[-1] == f"flash:w:{image}:i"
    assert "-D" in arguments
    assert "pty runs palpate's firmware 0.0.0" in shown


def test_flash_failure_ends_with_a_line_that_names_the_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, port: str, image: Path, palpate: Command
) -> None:
    log = install_avrdude(tmp_path, monkeypatch, output="not in sync: resp=0x00", status=1)
    shown = palpate("flash", "--port", port, "--board", "nano", "--image", image, status=3)
    assert port in shown.err.splitlines()[-1]
    assert "firmware" not in shown.out
    # The last attempt is at the baud rate of the Nano's old bootloader.
    arguments = log.read_text().split()
    assert arguments[:6] == ["-p", "atmega328p", "-c", "arduino", "-P", port]
    assert arguments[6:8] == ["-b", "57600"]


@pytest.mark.parametrize(
    ("output", "line"),
    [
        (
            "avrdude: Device signature = 0x1e950f (probably m328p)\n"
            "avrdude error: expected signature for ATmega2560 is 1E 98 01\n",
            "the board is an ATmega328P (Arduino Uno, Nano), not an Arduino Mega 2560",
        ),
        ("avrdude: Device signature = 0x000000\n", "the chip returned no signature"),
        ("avrdude: hello\navrdude error: strange thing\n", "avrdude error: strange"),
        ("", "no reason given"),
    ],
)
def test_flash_failure_is_explained(output: str, line: str) -> None:
    assert line in explain_failure(output)


def test_flash_checks_tool_port_and_image_before_writing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, port: str, image: Path, palpate: Command
) -> None:
    with monkeypatch.context() as patch:
        patch.setenv("PATH", str(tmp_path))
        error = palpate("flash", "--port", port, status=3).err
        assert "sudo apt install avrdude" in error
    log = install_avrdude(tmp_path, monkeypatch, output="", status=0)
    error = palpate("flash", "--port", "/dev/no-such-port", "--image", image, status=3).err
    assert "no port /dev/no-such-port" in error
    image.write_text(HEX.replace(":00000001FF\n", ""))
    error = palpate("flash", "--port", port, "--image", image, status=2).err
    assert "a truncated Intel hex file" in error
    palpate("flash", "--port", port, "--image", tmp_path / "none.hex", status=2)
    assert not log.exists()


@pytest.mark.parametrize(("kind", "baud"), IMAGES)
def test_firmware_images_in_the_repository_are_complete(kind: str, baud: int) -> None:
    try:
        path = image_path(kind, baud)
    except DeviceNotFoundError:
        skip("no firmware image; run `make -C firmware`")
    lines = path.read_text().split()
    assert lines[-1] == ":00000001FF"
    assert len(lines) > 100
