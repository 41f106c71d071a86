"""`palpate doctor` on the real firmware: a healthy sensor, and one with a broken wire."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from palpate.cli import build_app, run

_OPENER = """
from palpate.twin.firmware import open_firmware_array
from palpate.twin.world import World

class Broken(World):
    def pixel_voltage_v(self, time_s):
        volts = super().pixel_voltage_v(time_s)
        volts[2] = 0.0
        return volts

def open_array(*, broken):
    world = (Broken if broken else World)(None, seed=1)
    return open_firmware_array(world, noise_mv=1.5, rate_hz=250.0)
"""

pytestmark = pytest.mark.usefixtures("firmware_built")


@pytest.mark.parametrize("broken", [False, True])
def test_doctor_examines_the_firmware_board(
    broken: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "bench_with_firmware.py").write_text(_OPENER)
    monkeypatch.syspath_prepend(tmp_path)
    rig = tmp_path / "rig.toml"
    rig.write_text(
        f'[array]\nopen = "bench_with_firmware:open_array"\nbroken = {str(broken).lower()}\n'
    )
    arguments = ["doctor", "--rig", str(rig), "--duration", "2", "--json"]
    assert run(build_app(), arguments, name="palpate") == int(broken)
    document = json.loads(capsys.readouterr().out)
    found = [(finding["code"], finding["where"]) for finding in document["findings"]]
    assert found == ([("open", "row R2")] if broken else [])
    assert document["rate_hz"] == pytest.approx(250.0, rel=1e-3)
    assert document["frames"] == pytest.approx(500, abs=2)
    assert (document["frames_lost"], document["corrupt"], document["late"]) == (0, 0, 0)
    assert document["jitter_percent"] < 1.0
    assert abs(document["clock_drift_ppm"]) < 50
