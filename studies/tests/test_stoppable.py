"""A stop signal ends a whole study."""

from __future__ import annotations

import os
import signal
from typing import Any

import pytest

from palpate_studies import force_control_world
from palpate_studies.force_control import grip_all
from palpate_studies.force_control_world import draw_task, learn_damage


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_during_grasp_ends_study_with_hand_stopped(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.getsignal(number)
    worlds = list[Any]()

    class Gripper(force_control_world.TwinGripper):
        def command(self, wanted: Any) -> Any:
            os.kill(os.getpid(), number)
            worlds.append(self)
            return super().command(wanted)

    monkeypatch.setattr(force_control_world, "TwinGripper", Gripper)
    tasks = [draw_task(seed, level="lab") for seed in (8, 9)]
    with pytest.raises(KeyboardInterrupt):
        list(grip_all(tasks, damage=learn_damage(seed=1), laws={}))
    assert len(worlds) == 1
    assert not worlds[0].state().moving
    assert signal.getsignal(number) is before
