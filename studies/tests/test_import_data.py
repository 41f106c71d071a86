"""Tables from clones of public repositories, with synthetic files in the raw layouts."""

from __future__ import annotations

import io
import json
import re
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import build_app, run
from palpate.holds import read_holds
from palpate_studies.force_ladders import read_ladders
from palpate_studies.protocol import paired
from palpate_studies.strokes import read_strokes

VELOSTAT = "src/experimental_data/"


def clone(folder: Path, files: dict[str, bytes]) -> Path:
    """Create a repository with these files in one commit."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    git = ["git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-q", "-m", "recordings"]):
        subprocess.run([*git, *words], check=True)
    return folder


def strokes_files(
    *, peak_n: float = 8.0, sensor: str = "old_2", attempt: int = 0
) -> dict[str, bytes]:
    """Return one attempt of four touches, with separate clocks of force and resistance."""
    start = 1_620_000_000.0
    time_s = start + np.arange(0.0, 8.0, 0.007)
    since = (time_s - start) % 2.0 - 1.0
    force = np.interp(since, [0, 0.08, 0.28, 0.34], [0, peak_n, peak_n, 0])
    noise = np.random.default_rng(round(peak_n)).normal(0.0, 0.002, len(force))
    ohm = 1000.0 / (1.0 + 8.0 * force**1.2) * np.exp(noise)
    folder = f"{VELOSTAT}question_4/{sensor}/3_p/attempt_{attempt}/"
    late = time_s + 0.004
    lines = {
        f"exp_3_p_{attempt}.txt": [f"{r:.3f} {t:.4f}" for r, t in zip(ohm, late, strict=True)],
        f"exp_futek_extra_3_p_{attempt}.txt": [
            f"{f + 0.3:.3f} {t:.4f}" for f, t in zip(force, time_s, strict=True)
        ],
        f"exp_futek_3_p_{attempt}.txt": [
            f"0.0 {start + 2 * k + 1.1:.4f} touch_grd" for k in range(4)
        ],
    }
    # Broken lines, as in the logger's files.
    lines[f"exp_3_p_{attempt}.txt"].insert(20, "12.3 16200")
    lines[f"exp_futek_extra_3_p_{attempt}.txt"].insert(5, "garbled")
    return {folder + name: "\n".join(text).encode() for name, text in lines.items()}


def ladder_files() -> dict[str, bytes]:
    """Return six steps, with unsettled readings in the first seconds of each."""
    found = {}
    for step in range(6):
        load_kg = 0.1 * step
        ohm = 600.0 / (1.0 + 20.0 * load_kg)
        rows = [f"{ohm * (2.0 if t < 5 else 1.0):.3f} {1.6e9 + t:.1f} {load_kg}" for t in range(12)]
        name = f"{VELOSTAT}archive/velostat_data_for_calibration_old_1_good/experiment_{step}.txt"
        found[name] = "\n".join(rows).encode()
    return found


def npy(values: np.ndarray) -> bytes:
    content = io.BytesIO()
    np.save(content, values)
    return content.getvalue()


def fruit_files() -> dict[str, bytes]:
    """Return one closing of each fruit."""
    force = np.linspace(0.1, 6.0, 30)
    rows = "\n".join(f"{0.01 * k:.2f},{1000 + 10 * k},{f:.3f}" for k, f in enumerate(force))
    return {
        "banana/trainingSet/data_2.npy": npy(np.c_[1000 + np.arange(30.0), force]),
        "banana/trainingSet/label_2.npy": npy(force / 7.5),
        "kiwi/trainingSet/k1/ForceData_k1.csv": f"Time,Pos,Force\n{rows}\n".encode(),
        "kiwi/trainingSet/k1/break_force.npy": npy(np.array(3.5)),
        "kiwi/trainingSet/k2/ForceData_k2.csv": f"Time,Pos,Force\n{rows}\n".encode(),
        "mango/trainingSet/data/m1.csv": f"time,now_pos,now_force\n{rows}\n".encode(),
        "mango/trainingSet/labels/m1.txt": b"m1 soft 11.0\n",
    }


def run_import(
    capsys: pytest.CaptureFixture[str], *clones: Path, out: Path
) -> tuple[int, dict[str, int], str]:
    """Run the import; return exit status, row count of each file, and standard error."""
    words = ["study", "import-data", *map(str, clones), "--out", str(out), "--json"]
    status = run(build_app(), words, name="palpate")
    output = capsys.readouterr()
    files = json.loads(output.out)["files"] if status == 0 else []
    return status, {one["file"]: one["rows"] for one in files}, output.err


def test_import_data_writes_readable_strokes_and_ladders(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here = clone(tmp_path / "velostat", {**strokes_files(), **ladder_files()})
    status, files, err = run_import(capsys, here, out=tmp_path / "data")
    assert status == 0
    assert set(files) == {"velostat_strokes.csv.gz", "velostat_force_ladders.csv"}
    assert "5d5250765551 is not in this clone; reading its head" in err
    touches = read_strokes(tmp_path / "data" / "velostat_strokes.csv.gz")
    assert [one.touch for one in touches] == [0, 1, 2, 3]
    for one in touches:
        assert one.recording_id == "old_2-3mm-a0"
        # The load cell's offset and the resistance's delay are corrected.
        assert np.exp(one.log_force).max() == pytest.approx(8.0, abs=0.1)
        assert {"loading", "holding", "unloading"} <= set(one.phase[one.scored])
    (ladder,) = read_ladders(tmp_path / "data" / "velostat_force_ladders.csv")
    assert ladder.name == "old_1_good"
    np.testing.assert_allclose(ladder.load_n, 0.1 * np.arange(1, 6) * 9.80665, rtol=1e-3)
    np.testing.assert_allclose(
        ladder.resistance_ohm, 600.0 / (1 + 2.0 * np.arange(1, 6)), rtol=1e-3
    )


@pytest.mark.slow
def test_readme_data_commands_run_on_example_clones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    readme = (Path(__file__).resolve().parents[2] / "README.md").read_text()
    (block,) = (b for b in re.findall(r"```sh\n(.*?)```", readme, re.DOTALL) if "git clone" in b)
    monkeypatch.setattr(paired, "DRAWS", 100)
    # Two attempts per place, as the prior `place` requires.
    sensors = [
        strokes_files(peak_n=n, sensor=f"old_{n}", attempt=attempt)
        for n in (5, 11)
        for attempt in (0, 1)
    ]
    published = {
        "tactile-sensor-velostat": {name: text for one in sensors for name, text in one.items()},
        "FruitRuptureEstimate": fruit_files(),
    }
    for name, files in published.items():
        clone(tmp_path / "published" / name, files)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for line in block.splitlines():
        program, *words = shlex.split(line)
        if program == "git":
            source = tmp_path / "published" / Path(words[-1]).name
            subprocess.run(["git", "clone", "-q", str(source)], check=True)
        else:
            assert run(build_app(), words, name="palpate") == 0, line
    assert "Force of real Velostat under short touches" in capsys.readouterr().out


def test_import_data_writes_fruit_curves_and_index(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here = clone(tmp_path / "fruit", fruit_files())
    status, files, _ = run_import(capsys, here, out=tmp_path / "data")
    # The kiwi without a rupture force is skipped.
    assert (status, files) == (0, {"fruit_rupture.csv.gz": 90, "fruit_rupture_index.csv": 3})
    lines = (tmp_path / "data" / "fruit_rupture_index.csv").read_text().splitlines()
    assert lines == [
        "grasp_id,fruit,samples,rupture_force_n",
        "banana-01,banana,30,7.5",
        "kiwi-01,kiwi,30,3.5",
        "mango-01,mango,30,11",
    ]


def test_import_data_writes_holds_of_silicone_and_tape(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    time_s = np.arange(0.0, 60.0, 0.08)
    stretch = np.clip(5.0 * (time_s - 5.0), 0.0, 6.0)
    since = np.maximum(time_s - 6.2, 0.0)
    ohm = 8000.0 + 500.0 * stretch * (1.0 - 0.05 * np.log1p(since / 0.2))
    force = 0.3 * stretch * (1.0 - 0.03 * np.log1p(since / 0.2))
    rows = np.c_[ohm, ohm, time_s, stretch, time_s, force, time_s + 0.02]
    text = "\n".join(",".join(f"{x:.4f}" for x in row) for row in rows).encode()
    columns = (time_s, stretch, force)
    tape = "\n".join(f"{t:.2f},{s:.3f},{f:.4f}" for t, s, f in zip(*columns, strict=True))
    silicone = clone(tmp_path / "electromech-stretcher", {"logs/1_10_E4pin_v4.csv": text})
    vhb = clone(
        tmp_path / "vhb",
        {"single-step-relaxation/original_data/s.csv": b"a\nb\n" + tape.encode()},
    )
    status, files, _ = run_import(capsys, silicone, vhb, out=tmp_path / "data")
    assert status == 0
    assert set(files) == {
        *("holds_cbsilicone.csv.gz", "holds_force_relaxation.csv.gz", "holds_tape.csv.gz"),
    }
    for name in files:
        (hold,) = read_holds(tmp_path / "data" / name)
        assert hold.time_s[0] <= 0.03
        assert hold.time_s[-1] > 20.0
        assert hold.values[0] > hold.values[-1]


def test_import_data_writes_soft_sensor_strokes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = ["trial,x_location,z_location,speed,voltage,grad,force"]
    rows += [f"{trial},-15,-0.6,1,0.04{k},0.0,{-0.5 * k}" for trial in (7, 3) for k in range(4)]
    here = clone(tmp_path / "soft", {"data/loc_train.csv": "\n".join(rows).encode()})
    status, files, _ = run_import(capsys, here, out=tmp_path / "data")
    assert (status, files) == (0, {"soft_sensor_ral2018.csv.gz": 8})


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"README": b"no recordings"}, "contains no known recordings"),
        ({f"{VELOSTAT}question_4/old_2/3_p/attempt_0/x.txt": b"1 2\n"}, "no recording for"),
        (
            {
                "banana/trainingSet/data_1.npy": b"version https://git-lfs",
                "banana/trainingSet/label_1.npy": b"x",
            },
            "git lfs",
        ),
    ],
)
def test_import_data_unusable_clone_prints_one_line(
    tmp_path: Path, files: dict[str, bytes], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    here = clone(tmp_path / "clone", files)
    status, _, err = run_import(capsys, here, out=tmp_path / "data")
    assert status == 2
    assert message in err.splitlines()[-1]


def test_import_data_folder_without_git_prints_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = run_import(capsys, tmp_path / "absent", out=tmp_path / "data")
    assert status == 2
    assert "not a git clone" in err
    assert err.count("\n") == 1
