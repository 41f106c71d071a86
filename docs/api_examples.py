"""Examples of the pages of docs/api for names without one in their docstrings; a test runs them.

Of names with one example together, the first shows it on its page and the others refer to it.
"""

from __future__ import annotations

#: Names with one example, and the example.
EXAMPLES: tuple[tuple[tuple[str, ...], str], ...] = (
    (
        (
            "palpate.run_grasp",
            "palpate.plan_grasp",
            "palpate.Plan",
            "palpate.GraspResult",
            "palpate.Outcome",
            "palpate.grasp.result.Moment",
            "palpate.grasp.verdict.verdict",
            "palpate.clock.Clock",
        ),
        """\
>>> import palpate
>>> from palpate.grasp.verdict import verdict
>>> with palpate.open_rig("sim-rigid", object_name="tomato", seed=4) as rig:
...     plan = palpate.plan_grasp(rig.calibration, gripper=rig.gripper, target_force_n=2.0)
...     result = palpate.run_grasp(plan, array=rig.array, gripper=rig.gripper, clock=rig.clock)
>>> result.outcome is palpate.Outcome.HELD, plan.target_force_n
(True, 2.0)
>>> result.moments[-1].name, verdict(result, target_force_n=2.0)["text"]
('held', 'held and released')
""",
    ),
    (
        (
            "palpate.Grip",
            "palpate.Reading",
            "palpate.sensor.array.PressureArray",
            "palpate.gripper.interface.Gripper",
        ),
        """\
>>> import palpate
>>> with palpate.open_rig("sim-rigid", object_name="tomato", seed=4) as rig:
...     frame, state = rig.array.read(timeout_s=1.0), rig.gripper.state()
...     grip = rig.grasp(target_force_n=2.0)
...     reading, result = grip.read(), grip.release()
>>> frame.counts.shape, round(state.width_mm), reading.change_percent.shape
((4, 2), 74, (4, 2))
>>> 1.0 < reading.force_n.value < 3.0, str(grip.outcome)
(True, 'held')
""",
    ),
    (
        (
            "palpate.load_recording",
            "palpate.recording.Recording",
            "palpate.recording.RecordingInfo",
            "palpate.recording.RecordingReader",
            "palpate.recording.RecordingWriter",
            "palpate.recording.recover",
        ),
        """\
>>> import tempfile
>>> from pathlib import Path
>>> import palpate
>>> from palpate.recording import RecordingReader, RecordingWriter, recover
>>> folder = Path(tempfile.mkdtemp())
>>> with palpate.open_rig("sim-rigid", object_name="tomato", seed=4) as rig:
...     held = rig.grasp(target_force_n=2.0, record=folder / "one.mcap").release()
>>> recording = palpate.load_recording(folder / "one.mcap")
>>> recording.counts.shape[1:], recording.info.origin
((4, 2), 'twin')
>>> with RecordingWriter(folder / "two.mcap", info=recording.info):
...     pass
>>> with RecordingReader(folder / "one.mcap") as reader:
...     reader.info.layout.name
'rigid-2x2'
>>> state = recover(folder / "one.mcap", folder / "copy.mcap")
>>> len(palpate.load_recording(folder / "copy.mcap").time_s) == len(recording.time_s)
True
""",
    ),
    (
        (
            "palpate.calibration.RestValues",
            "palpate.calibration.ForcePairs",
            "palpate.calibration.BlockPairs",
        ),
        """\
>>> import palpate
>>> with palpate.open_rig("sim-rigid", object_name="tomato", seed=4) as rig:
...     made = rig.calibration
>>> len(made.rest.ohm), len(made.force.force_n) == len(made.force.excess)
(4, True)
>>> float(made.block.block_mm[0])
40.0
""",
    ),
    (
        (
            "palpate.sensor.serial_array.SerialArray",
            "palpate.sensor.one_way_array.OneWayArray",
            "palpate.sensor.text_lines.open_board",
            "palpate.sensor.flexitac.open_board",
            "palpate.sensor.array.LinkCounters",
        ),
        """\
>>> from palpate.sensor import board_array, flexitac, text_lines  # each needs its board
>>> board_array.open_board(port="/dev/ttyACM0", layout="rigid-2x2")  # doctest: +SKIP
>>> text_lines.open_board(port="/dev/ttyUSB0", layout="4x2")  # doctest: +SKIP
>>> with flexitac.open_board(port="/dev/ttyUSB0") as array:  # doctest: +SKIP
...     frame, lost = array.read(timeout_s=1.0), array.counters().lost
""",
    ),
    (
        ("palpate.FittedForce", "palpate.force.force_law.Population"),
        """\
>>> import palpate
>>> weights = {"load_n": [0, 1.5, 4.0, 9.0], "R_ohm": [9000, 900, 350, 150]}
>>> fitted = palpate.fit_force(weights)
>>> force = fitted.law.force(20.0)
>>> force.low < force.value < force.high
True
""",
    ),
    (
        ("palpate.force.line_law.ForceEstimate",),
        """\
>>> from palpate.force.line_law import LineForceLaw
>>> law = LineForceLaw.fit([-10.0, -20, -30, -40, -52], force_n=[3.0, 4, 5, 6, 7])
>>> estimate = law.force_n([-35.0])
>>> bool(estimate.low[0] < estimate.value[0] < estimate.high[0])
True
""",
    ),
    (
        ("palpate.ReadingTable", "palpate.ScoreTable"),
        """\
>>> import numpy as np
>>> import palpate
>>> time_s = np.arange(0.0, 30.0, 0.1)
>>> ohm = np.where(time_s < 5.0, 9000.0, 900.0 - 20.0 * np.log(np.maximum(time_s - 4.6, 0.4)))
>>> readings = palpate.read_recording({"time_s": time_s, "R_ohm": ohm})
>>> len(readings.columns), len(palpate.cut_holds(readings))
(1, 1)
>>> table = palpate.score(palpate.cut_holds(readings), methods=["recorded"], cutoffs_s=[2.5])
>>> len([*table.rows()])
1
""",
    ),
    (
        (
            "palpate.scoring.deciding.find_decision",
            "palpate.scoring.deciding.Decision",
            "palpate.settling.result.SettlingMethod",
            "palpate.Exponential",
            "palpate.Status",
        ),
        """\
>>> import numpy as np
>>> import palpate
>>> from palpate.scoring.deciding import find_decision
>>> time_s = np.arange(0.0, 10.0, 0.1)
>>> hold = 100.0 - 5.0 * np.log(time_s + 0.4)
>>> found = find_decision(time_s, hold, method=palpate.Relaxation(), half_width_percent=4.0)
>>> bool(found.decided), bool(found.time_s < 8.0)
(True, True)
>>> hold = 40 * np.exp(-time_s) - 60
>>> settled = palpate.predict_settled(time_s, hold, method=palpate.Exponential())
>>> round(float(settled.value), 3), settled.status is palpate.Status.OK
(-60.0, True)
""",
    ),
)
