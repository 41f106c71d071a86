"""`palpate replay FILE`: rerun a recorded grasp, or print recorded frames."""

from __future__ import annotations

import json
from typing import Annotated

from palpate.cli import options as option
from palpate.cli.grasp_card import print_card
from palpate.cli.options import CutoffOption, EpsilonOption, JsonOption, Method, opt, paper_settings
from palpate.cli.output import print_json, print_message
from palpate.clock import ManualClock
from palpate.grasp.document import GraspDocument
from palpate.grasp.replay_grasp import evaluate_with_paper_method, replay_grasp
from palpate.recording import RecordingReader, Replay
from palpate.recording.replay import observations


def replay(
    file: option.RecordingArgument,
    frames: Annotated[
        bool, opt("--frames", "Print the frames instead of the grasp's result.")
    ] = False,
    method: Annotated[
        Method | None, opt("--method NAME", "paper: evaluate the grasp with the paper's method.")
    ] = None,
    epsilon_percent: EpsilonOption = None,
    cutoff_s: CutoffOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run a recorded grasp through the controller again.

    The result equals that of the original grasp. With --method paper, contact, size, settled value
    and force are evaluated with the paper's method on the recorded motion.

    Without a recorded calibration or gripper, the frames are printed, with a word about it.

    Example: palpate grasp --record run.mcap && palpate replay run.mcap
    """
    paper = paper_settings(method or "palpate", epsilon_percent=epsilon_percent, cutoff_s=cutoff_s)
    with RecordingReader(file) as reader:
        start_s = next((frame.time_s for frame, _ in observations(reader)), 0.0)
    clock = ManualClock(start_s)
    source = Replay(file, clock=clock)
    try:
        absent = [what for what in ("gripper", "calibration") if getattr(source.info, what) is None]
        if absent and not frames:
            print_message(
                f"{file}: no grasp to replay, because the recording has no "
                f"{' and no '.join(absent)}; its frames follow"
            )
        if frames or absent:
            _play(source, as_json=as_json)
            return
        result = (
            replay_grasp(source, clock=clock)
            if paper is None
            else evaluate_with_paper_method(source, paper)
        )
    finally:
        source.close()
    info = source.info
    is_simulated = info.origin != "hardware"
    if as_json:
        print_json({**result.to_dict(), "recording": str(file), "simulated": is_simulated})
    else:
        print_card(
            GraspDocument(result=result, is_simulated=is_simulated),
            title=f"[bold]{file.name}[/], {info.rig or info.layout.name}",
            seed=info.seed,
        )


def _play(source: Replay, *, as_json: bool) -> None:
    played = []
    while not source.has_ended:
        frame = source.read(timeout_s=float("inf"))
        if as_json:
            counts = frame.counts.tolist()
            played.append({"time_s": frame.time_s, "sequence": frame.sequence, "counts": counts})
        else:
            counts = " ".join(f"{count:5d}" for count in frame.counts.ravel())
            print(f"{frame.time_s:12.4f} s  {frame.sequence:8d}  {counts}")
    if as_json:
        print(json.dumps({"frames": played}))
