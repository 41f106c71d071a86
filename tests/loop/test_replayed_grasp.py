"""A replay of a recorded grasp reproduces the live result."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from tests.commands import Command
from tests.served_pages import POLL_PERIOD_S, SIMULATED, Machine, serve_dashboard

from palpate.clock import ManualClock
from palpate.errors import RecordingError
from palpate.grasp.phases import Phase
from palpate.grasp.plan import HOLD_S
from palpate.grasp.planning import plan_grasp
from palpate.grasp.replay_grasp import replay_grasp
from palpate.grasp.requests import Requests
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.recording import (
    RecordingInfo,
    RecordingWriter,
    Replay,
    ReplayGripper,
    load_recording,
)
from palpate.rig import open_rig
from palpate.rig.recorded import record_grasp
from palpate.sensor.array import RIGID_LAYOUT


def test_replay_of_a_served_grasp_reproduces_the_stored_result(
    tmp_path: Path, palpate: Command
) -> None:
    rules = tmp_path / "rules.toml"
    rules.write_text('default = "by hand"\n[[rule]]\nbin = "large"\nsize_mm = [30, 200]\n')
    with serve_dashboard(tmp_path, *SIMULATED, "--rules", str(rules)) as address:
        machine = Machine(address)
        machine.ask("PUT", "/driver")
        machine.ready()
        machine.ask("POST", "/grasp", {"target_force_n": 2, "item_id": "berry-1"})
        machine.until(lambda at: at["phase"] == "hold" and at["answered"])
        # At ten times the speed, the hold is longer than with `palpate grasp`.
        polls = itertools.count()
        machine.until(lambda _: POLL_PERIOD_S * next(polls) > HOLD_S)
        machine.ask("POST", "/release")
        machine.until(lambda at: machine.ask("GET", "/result")[0] == 200)
        served_grasp = machine.ask("GET", "/result")[1]
    (file,) = (tmp_path / "data").glob("*.mcap")
    replayed = palpate("replay", file, "--json").document
    assert replayed.pop("recording") == str(file)
    assert replayed.pop("simulated") is True
    assert replayed == {name: served_grasp[name] for name in replayed}
    assert served_grasp["outcome"] == "held"
    store = tmp_path / "items.sqlite"
    (grasp,) = palpate("items", "berry-1", "--store", store, "--json").document["grasps"]
    for name in ("size_mm", "force_n", "stiffness_n_per_mm", "settled_percent", "firmness"):
        # The store contains numbers only, no bounds.
        is_number = replayed[name] is not None and replayed[name]["value"] is not None
        assert grasp["measurements"].get(name) == (replayed[name] if is_number else None)
    sort = ("sort", "--store", store, "--rules", rules, "--json")
    (item,) = palpate(*sort).document["rows"]
    assert item["bin"] == served_grasp["bin"]["name"]
    assert item["bin"] == "large"


@pytest.mark.parametrize(
    ("request_in", "name", "outcome"),
    [
        (Phase.HOLD, "release", "held"),
        (Phase.SQUEEZE, "release", "stopped"),
        (Phase.SQUEEZE, "stop", "stopped"),
    ],
)
def test_replay_of_a_grasp_ended_by_the_user_ends_at_the_same_frame(
    tmp_path: Path, request_in: Phase, name: str, outcome: str
) -> None:
    file, requests = tmp_path / "run.mcap", Requests()
    rig = open_rig("sim-rigid", seed=3)
    plan = plan_grasp(rig.calibration, gripper=rig.gripper, target_force_n=2.0, hold_s=60.0)
    seen_in: list[float] = []

    def send_request(state: GraspState) -> None:
        if state.phase is request_in:
            seen_in.append(state.estimate.now_s)
        if seen_in and state.estimate.now_s > seen_in[0] + 2.0 * (request_in is Phase.HOLD):
            getattr(requests, name).set()

    with record_grasp(file, rig=rig, plan=plan, damage=None) as recorder:
        result = run_grasp(
            plan,
            array=rig.array,
            gripper=rig.gripper,
            clock=rig.clock,
            subscribers=[recorder],
            watchers=[send_request],
            requests=requests,
        )
        recorder.end(result, requests)
    assert result.outcome == outcome
    clock = ManualClock(load_recording(file).time_s[0])
    source = Replay(file, clock=clock)
    assert replay_grasp(source, clock=clock) == result
    source.close()


def test_replay_of_a_recording_without_a_gripper_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bare.mcap"
    with RecordingWriter(path, info=RecordingInfo(layout=RIGID_LAYOUT, origin="hardware")):
        pass
    source = Replay(path, clock=ManualClock())
    with pytest.raises(RecordingError, match="not the recording of a grasp"):
        ReplayGripper(source)
    source.close()
