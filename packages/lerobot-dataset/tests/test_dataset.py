"""Simulated grasps as a LeRobot data set, read by pyarrow and pandas as LeRobot does.

LeRobot itself is too heavy for the tests; `packages/lerobot/check_with_lerobot.py` uses it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from tests.commands import run_palpate as palpate
from tests.pages import test_commands_of_page_run

from palpate.errors import RecordingError
from palpate.grasp.phases import Phase
from palpate.grasp.planning import plan_grasp
from palpate.grasp.requests import Requests
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.gripper.interface import Gripper, GripperCommand
from palpate.recording import RecordingWriter, load_recording
from palpate.rig import open_rig
from palpate.rig.recorded import record_grasp
from palpate_lerobot.episode import read_grasp

__all__ = ["test_commands_of_page_run"]
pytestmark = pytest.mark.slow


@pytest.fixture
def page() -> str:
    """The page's rigs are calibrated for this file's recordings."""
    return "lerobot"


TARGET_N = 2.0
#: A camera's rate, at which LeRobot's data sets are recorded.
RATE_HZ = 15
DATA, EPISODES = "data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet"


class RecordingGripper:
    """A gripper that records the sent commands with their times."""

    def __init__(self, gripper: Gripper) -> None:
        self._gripper, self.sent = gripper, list[tuple[float, GripperCommand]]()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._gripper, name)

    def command(self, wanted: GripperCommand) -> GripperCommand:
        sent = self._gripper.command(wanted)
        self.sent.append((self._gripper.state().time_s, sent))
        return sent


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two grasps; the second has a target force."""
    folder = tmp_path_factory.mktemp("grasps")
    rig = ["--rig", "sim-rigid", "--rate-hz", RATE_HZ]
    palpate("grasp", *rig, "--seed", 1, "--record", folder / "gentle.mcap")
    options = ["--target-force-n", TARGET_N, "--record", folder / "firm.mcap"]
    palpate("grasp", *rig, "--seed", 2, *options)
    return folder


@pytest.fixture(scope="module")
def dataset(recorded: Path) -> Path:
    folder = recorded / "dataset"
    files = [recorded / "gentle.mcap", recorded / "firm.mcap"]
    assert palpate("export", *files, "--lerobot", folder) == 0
    return folder


def read(dataset: Path, file: str) -> dict[str, np.ndarray]:
    table = pq.read_table(dataset / file)
    return {name: np.array(table[name].to_pylist()) for name in table.column_names}


def info_of(dataset: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((dataset / "meta/info.json").read_text())
    return found


def test_recomputed_commands_equal_sent_commands(tmp_path: Path) -> None:
    file, rig = tmp_path / "run.mcap", open_rig("sim-rigid", seed=3, rate_hz=250.0)
    hand = RecordingGripper(rig.gripper)
    plan = plan_grasp(rig.calibration, gripper=hand, target_force_n=TARGET_N)
    with record_grasp(file, rig=rig, plan=plan, damage=None) as recorder:
        run_grasp(plan, array=rig.array, gripper=hand, clock=rig.clock, subscribers=[recorder])
    track = read_grasp(file)
    assert len(hand.sent) > 10
    for at_s, sent in hand.sent:
        frame = np.searchsorted(track.time_s, at_s + 1e-6) - 1
        assert track.action[frame].tolist() == [sent.target, sent.rate]
    still = track.time_s < hand.sent[0][0]
    assert (track.action[still, 1] == 0.0).all()
    assert track.action[still, 0] == pytest.approx(track.state[still, 0])


def release_during(file: Path, *, phase: Phase, recorded_end: bool) -> GraspResult:
    """Grasp, and release in a phase like a user."""
    rig, requests = open_rig("sim-rigid", seed=3, rate_hz=RATE_HZ), Requests()
    plan = plan_grasp(rig.calibration, gripper=rig.gripper, target_force_n=TARGET_N, hold_s=60.0)

    def release(grasp_state: GraspState) -> None:
        if grasp_state.phase is phase and grasp_state.phase_time_s > 0.2:
            requests.release.set()

    with record_grasp(file, rig=rig, plan=plan, damage=None) as recorder:
        result = run_grasp(
            plan,
            array=rig.array,
            gripper=rig.gripper,
            clock=rig.clock,
            subscribers=[recorder],
            watchers=[release],
            requests=requests,
        )
        if recorded_end:
            recorder.end(result, requests)
    return result


def test_grasp_released_by_user_is_an_episode_if_its_end_is_recorded(tmp_path: Path) -> None:
    file = tmp_path / "released.mcap"
    result = release_during(file, phase=Phase.HOLD, recorded_end=True)
    track = read_grasp(file)
    assert (track.outcome, len(track.time_s)) == ("held", result.frames)
    for phase, recorded_end, reason in (
        (Phase.HOLD, False, "gripper_fault"),
        (Phase.APPROACH, True, "the user stopped the grasp"),
    ):
        cut = tmp_path / f"{phase.value}.mcap"
        release_during(cut, phase=phase, recorded_end=recorded_end)
        with pytest.raises(RecordingError, match=rf"{phase.value}\.mcap: .*{reason}"):
            read_grasp(cut)


def test_states_match_recording(recorded: Path, dataset: Path) -> None:
    frames, names = read(dataset, DATA), info_of(dataset)["features"]["observation.state"]["names"]
    first = frames["observation.state"][frames["episode_index"] == 0]
    recording = load_recording(recorded / "gentle.mcap")
    assert first.shape == (len(recording.time_s), len(names))
    widths = np.interp(recording.time_s, recording.gripper.time_s, recording.gripper.width_mm)
    assert first[:, names.index("width_mm")] == pytest.approx(widths, abs=1e-3)
    force, low, high = (first[:, names.index(f"force_{one}n")] for one in ("", "low_", "high_"))
    assert ((low <= force) & (force <= high)).all()
    pixels = first[:, 4:]
    assert np.abs(pixels[:5]).max() < 5.0, "no contact at the start"
    assert pixels.min() < -20.0
    firm = frames["observation.state"][frames["episode_index"] == 1]
    assert firm[:, 1].max() == pytest.approx(TARGET_N, rel=0.5)
    assert firm[:8, 1].max() < 0.5


def test_frames_have_numbers_and_times_of_lerobot_format(dataset: Path) -> None:
    frames, info = read(dataset, DATA), info_of(dataset)
    assert info["codebase_version"] == "v3.0"
    assert list(frames) == list(info["features"])
    schema = pq.read_schema(dataset / DATA)
    for name, feature in info["features"].items():
        kind = schema.field(name).type
        if feature["shape"] == [1]:
            assert str(kind).replace("float", "float32") == feature["dtype"]
        else:
            assert str(kind.value_type) == "float"
            assert kind.list_size == feature["shape"][0] == len(feature["names"])
    assert info["fps"] == RATE_HZ
    assert frames["timestamp"] == pytest.approx(frames["frame_index"] / RATE_HZ, abs=1e-5)
    assert frames["index"].tolist() == list(range(info["total_frames"]))
    assert np.flatnonzero(frames["frame_index"] == 0).tolist() == [
        0,
        int((frames["episode_index"] == 0).sum()),
    ]


def test_episodes_have_bounds_tasks_and_origin(dataset: Path) -> None:
    frames, info = read(dataset, DATA), info_of(dataset)
    episodes = pq.read_table(dataset / EPISODES).to_pylist()
    tasks = pd.read_parquet(dataset / "meta/tasks.parquet")
    assert info["total_episodes"] == len(episodes) == 2
    assert info["total_tasks"] == len(tasks) == 2
    assert info["splits"] == {"train": "0:2"}
    for number, episode in enumerate(episodes):
        part = slice(episode["dataset_from_index"], episode["dataset_to_index"])
        assert set(frames["episode_index"][part]) == {number}
        assert episode["length"] == len(frames["index"][part])
        (text,) = episode["tasks"]
        assert set(frames["task_index"][part]) == {tasks.loc[text].task_index}
        assert (episode["palpate/origin"], episode["palpate/simulated"]) == ("twin", True)
        assert episode["palpate/outcome"] == "held"
    assert "2 N" in tasks.index[1]
    assert (info["palpate"]["origins"], info["palpate"]["simulated"]) == (["twin"], True)
    assert "SIMULATED" in info["robot_type"]
    assert "SIMULATED" in (dataset / "README.md").read_text()


def test_lower_fps_selects_nearest_frames(recorded: Path, tmp_path: Path) -> None:
    track = read_grasp(recorded / "gentle.mcap")
    assert track.rate_hz == pytest.approx(RATE_HZ)
    folder = tmp_path / "slow"
    file = recorded / "gentle.mcap"
    assert palpate("export", file, "--lerobot", folder, "--fps", 5, "--task", "Touch.") == 0
    assert info_of(folder)["fps"] == 5
    nearest, found = track.state[::3], read(folder, DATA)["observation.state"]
    # The last tick may be nearest to the last frame.
    assert len(found) - len(nearest) in (0, 1)
    assert found[: len(nearest)] == pytest.approx(nearest, rel=1e-6)
    assert pd.read_parquet(folder / "meta/tasks.parquet").index.tolist() == ["Touch."]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["gentle.mcap", "--lerobot", "new", "--fps", "300"], "lower --fps"),
        (["cut.mcap", "--lerobot", "new"], "cut.mcap: the recomputed grasp ends"),
        (["pad.mcap", "--lerobot", "new"], "pad.mcap: not the recording of a grasp"),
        (["gentle.mcap", "soft.mcap", "--lerobot", "new"], "must have one kind"),
        (["gentle.mcap", "--lerobot", "there"], "already exists"),
        (["gentle.mcap", "--lerobot", "no/new"], "create it first"),
        (["gentle.mcap", "--lerobot", "new", "--holds"], "can't be combined with"),
        (["gentle.mcap", "--fps", "15"], "--lerobot"),
        (["gentle.mcap", "firm.mcap"], "only one recording can be exported"),
    ],
)
def test_export_lerobot_of_unusable_input_is_refused_without_files(
    recorded: Path,
    words: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(recorded)
    (recorded / "there").mkdir(exist_ok=True)
    if "soft.mcap" in words and not Path("soft.mcap").exists():
        rig = ["--rig", "sim-soft", "--rate-hz", RATE_HZ]
        palpate("grasp", *rig, "--seed", 1, "--record", "soft.mcap")
    if "pad.mcap" in words:
        palpate("record", "pad.mcap", "--rig", "sim-rigid", "--duration", "1")
    if "cut.mcap" in words:
        _cut("gentle.mcap", "cut.mcap")
    capsys.readouterr()
    before = sorted(recorded.iterdir())
    assert palpate("export", *words) == 2
    error = capsys.readouterr().err
    assert message in error
    assert len(error.strip().splitlines()) == 1
    assert sorted(recorded.iterdir()) == before


def _cut(whole: str, half: str) -> None:
    """Write the first half of a recording, as after a killed process."""
    from palpate.recording import RecordingReader

    with RecordingReader(whole) as reader:
        messages = list(reader.messages())
        with RecordingWriter(half, info=reader.info) as writer:
            for message in messages[: len(messages) // 2]:
                writer.add(message)
