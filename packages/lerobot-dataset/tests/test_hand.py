"""A policy's hand on the twin: its observations and its force limit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import DeviceTimeoutError, InputError
from palpate.object.damage import fit_damage_model
from palpate.object.damage_file import DamageFile
from palpate.object.strength import ClosingCurve
from palpate.rig import Rig, open_rig
from palpate.sensor.array import Frame
from palpate_lerobot.hand import PolicyHand, read_learned_limit_n

pytestmark = pytest.mark.slow

CLOSED = {"width_mm": 5.0, "rate_mm_per_s": 60.0}
OPEN = {"width_mm": 74.0, "rate_mm_per_s": 60.0}


def rig_with(name: str) -> Rig:
    """Return a rig at the rate of a policy's camera."""
    return open_rig("sim-rigid", object_name=name, seed=1, rate_hz=15.0)


def hand_of(rig: Rig, *, limit_n: float) -> PolicyHand:
    return PolicyHand(rig.array, rig.gripper, calibration=rig.calibration, limit_n=limit_n)


@pytest.mark.parametrize("name", ["strawberry", "rigid-block"])
def test_policy_that_only_closes_stays_below_limit(name: str) -> None:
    rig = rig_with(name)
    hand = hand_of(rig, limit_n=3.0)
    strongest_n = 0.0
    for _ in range(500):
        strongest_n = max(strongest_n, hand.observe()["force_n"])
        sent = hand.send(CLOSED)
        assert sent["width_mm"] > CLOSED["width_mm"]
    assert rig.truth is not None
    truth = rig.truth()
    assert not truth["damaged"]
    # The limit applies to the upper force; the true force exceeds it by less than a tenth here.
    assert 1.0 < truth["peak_force_n"] < 3.3
    assert strongest_n < 3.3


def test_opening_is_never_limited_and_bad_input_is_refused() -> None:
    rig = rig_with("ball-44lbs")
    hand = hand_of(rig, limit_n=6.0)
    for wanted in (CLOSED, OPEN):
        for _ in range(200):
            seen = hand.observe()
            sent = hand.send(wanted)
        assert (seen["force_n"] > 2.0) is (wanted is CLOSED)
    assert sent == OPEN
    assert hand.observe()["width_mm"] == pytest.approx(74.0)
    assert hand.send(CLOSED)["width_mm"] > 70.0
    for action in ({"width_mm": 40.0}, {"width_mm": float("nan"), "rate_mm_per_s": 5.0}):
        with pytest.raises(InputError, match="finite values of width_mm, rate_mm_per_s"):
            hand.send(action)
    for limit_n in (0.0, 15.1, float("nan")):
        with pytest.raises(InputError, match="limit_n"):
            hand_of(rig, limit_n=limit_n)


def test_observe_without_frames_stops_fingers(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = rig_with("ball-44lbs")
    hand = hand_of(rig, limit_n=6.0)
    hand.send({"width_mm": 60.0, "rate_mm_per_s": 1.0})
    assert rig.gripper.state().moving

    def read(self: object, *, timeout_s: float) -> Frame:
        raise DeviceTimeoutError(f"no frame within {timeout_s:g} s")

    monkeypatch.setattr(type(rig.array), "read", read)
    with pytest.raises(DeviceTimeoutError):
        hand.observe()
    assert not rig.gripper.state().moving


def damage_file(path: Path, *, n: Callable[[float], float]) -> Path:
    """Write a damage file learned from springs of 2 to 12 N/mm."""
    rng, paths, limits_n = np.random.default_rng(3), [], []
    for stiffness in np.geomspace(2.0, 12.0, 24):
        limits_n.append(float(n(stiffness) * np.exp(0.1 * rng.standard_normal())))
        curve, steps = ClosingCurve(), []
        for x_mm in np.arange(0.05, limits_n[-1] / stiffness, 0.05):
            steps += curve.push(float(x_mm), force_n=float(stiffness * x_mm))
        paths.append(steps)
    model = fit_damage_model(paths, rupture_force_n=limits_n, kinds=["spring"] * len(paths))
    file = DamageFile(model=model, closings={"spring": 24}, learned_from={}, made_at="2026-01-01")
    path.write_text(file.as_text())
    return path


def test_learned_limit_is_below_all_rupture_forces(tmp_path: Path) -> None:
    weak = read_learned_limit_n(damage_file(tmp_path / "weak.json", n=lambda _: 4.0))
    by_stiffness = damage_file(tmp_path / "stiff.json", n=lambda stiffness: stiffness)
    assert 1.0 < weak < 4.0
    assert read_learned_limit_n(by_stiffness, kind="spring") < 2.0
    strong = damage_file(tmp_path / "strong.json", n=lambda _: 80.0)
    assert read_learned_limit_n(strong) == 15.0
    with pytest.raises(InputError, match="pear"):
        read_learned_limit_n(strong, kind="pear")
