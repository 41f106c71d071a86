"""The latency timer of a USB adapter, from a made-up /sys."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.sensor.usb_latency import explain_latency, latency_timer_ms


def write_timer(sysfs: Path, device: str, text: str) -> Path:
    timer = sysfs / "bus/usb-serial/devices" / device / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text(text)
    return timer


def test_slow_timer_is_explained_with_its_own_path_through_a_link(tmp_path: Path) -> None:
    timer = write_timer(tmp_path, "ttyUSB7", "16\n")
    link = tmp_path / "usb-FTDI_U2D2-if00-port0"
    link.symlink_to("/dev/ttyUSB7")
    assert latency_timer_ms(str(link), sysfs=tmp_path) == 16
    text = explain_latency(str(link), sysfs=tmp_path)
    assert "16 ms" in text
    assert str(timer) in text
    timer.write_text("1\n")
    assert explain_latency(str(link), sysfs=tmp_path) is None


@pytest.mark.parametrize("text", ["", "fast\n", "\xff"])
def test_unreadable_timer_is_unknown(text: str, tmp_path: Path) -> None:
    write_timer(tmp_path, "ttyUSB0", text)
    assert latency_timer_ms("/dev/ttyUSB0", sysfs=tmp_path) is None
    assert explain_latency("/dev/ttyUSB0", sysfs=tmp_path) is None


def test_other_ports_have_no_timer(tmp_path: Path) -> None:
    write_timer(tmp_path, "ttyUSB0", "16\n")
    for port in ("/dev/ttyACM0", "/dev/ttyUSB1", "COM3", "", "/"):
        assert explain_latency(port, sysfs=tmp_path) is None
