"""Tables from clones of public repositories, with synthetic files in the raw layouts."""

from __future__ import annotations

import io
import json
import re
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import build_app, run
from palpate_studies.force_ladders import read_ladders
from palpate_studies.protocol import paired
from palpate_studies.strokes import read_strokes

VELOSTAT = "src/experimental_data/"
PLACE = f"{VELOSTAT}question_4/old_2/3_p/attempt_0/"
Files = dict[str, bytes]


def clone(folder: Path, files: Files) -> Path:
    """Create a repository with these files in one commit."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    git = ["git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-q", "-m", "recordings"]):
        subprocess.run([*git, *words], check=True)
    return folder


def lines_of(form: str, *columns: np.ndarray) -> list[str]:
    return [form.format(*row) for row in zip(*columns, strict=True)]


def strokes_files(*, peak_n: float = 8.0, sensor: str = "old_2", attempt: int = 0) -> Files:
    """Return one attempt of four touches, with separate clocks of force and resistance."""
    start = 1_620_000_000.0
    time_s = start + np.arange(0.0, 8.0, 0.007)
    since = (time_s - start) % 2.0 - 1.0
    force = np.interp(since, [0, 0.08, 0.28, 0.34], [0, peak_n, peak_n, 0])
    noise = np.random.default_rng(round(peak_n)).normal(0.0, 0.002, len(force))
    ohm = lines_of("{:.3f} {:.4f}", 1000 / (1 + 8 * force**1.2) * np.exp(noise), time_s + 0.004)
    newtons = lines_of("{:.3f} {:.4f}", force + 0.3, time_s)
    # Broken lines, as in the logger's files.
    ohm.insert(20, "12.3 16200")
    newtons.insert(5, "garbled")
    touches = [f"0.0 {start + 2 * k + 1.1:.4f} touch_grd" for k in range(4)]
    folder = f"{VELOSTAT}question_4/{sensor}/3_p/attempt_{attempt}/"
    kinds = {"": ohm, "futek_extra_": newtons, "futek_": touches}
    return {
        f"{folder}exp_{kind}3_p_{attempt}.txt": "\n".join(text).encode()
        for kind, text in kinds.items()
    }


def ladder_files() -> Files:
    """Return six steps, with unsettled readings in the first seconds of each."""
    folder = f"{VELOSTAT}archive/velostat_data_for_calibration_old_1_good/"
    time_s, found = np.arange(12), {}
    for step in range(6):
        ohm = 600.0 / (1.0 + 2.0 * step) * np.where(time_s < 5, 2.0, 1.0)
        rows = lines_of(f"{{:.3f}} {{:.1f}} {0.1 * step}", ohm, 1.6e9 + time_s)
        found[f"{folder}experiment_{step}.txt"] = "\n".join(rows).encode()
    return found


def npy(values: np.ndarray) -> bytes:
    content = io.BytesIO()
    np.save(content, values)
    return content.getvalue()


def fruit_files() -> Files:
    """Return one closing of each fruit, and one of a kiwi without a rupture force."""
    force = np.linspace(0.1, 6.0, 30)
    rows = "\n".join(f"{0.01 * k:.2f},{1000 + 10 * k},{f:.3f}" for k, f in enumerate(force))
    kiwi = f"Time,Pos,Force\n{rows}\n".encode()
    return {
        "banana/trainingSet/data_2.npy": npy(np.c_[1000 + np.arange(30.0), force]),
        "banana/trainingSet/label_2.npy": npy(force / 7.5),
        "kiwi/trainingSet/k1/ForceData_k1.csv": kiwi,
        "kiwi/trainingSet/k1/break_force.npy": npy(np.array(3.5)),
        "kiwi/trainingSet/k2/ForceData_k2.csv": kiwi,
        "mango/trainingSet/data/m1.csv": f"time,now_pos,now_force\n{rows}\n".encode(),
        "mango/trainingSet/labels/m1.txt": b"m1 soft 11.0\n",
    }


Import = Callable[..., tuple[int, dict[str, int], str]]


@pytest.fixture
def run_import(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Import:
    """Return a function that imports repositories of files into the folder `data`.

    It returns exit status, number of rows of each file, and standard error.
    """

    def import_data(**repositories: Files | None) -> tuple[int, dict[str, int], str]:
        clones = [
            tmp_path / name if files is None else clone(tmp_path / name, files)
            for name, files in repositories.items()
        ]
        words = ["study", "import-data", *map(str, clones), "--out", str(tmp_path / "data")]
        status = run(build_app(), [*words, "--json"], name="palpate")
        output = capsys.readouterr()
        files = json.loads(output.out)["files"] if status == 0 else []
        return status, {one["file"]: one["rows"] for one in files}, output.err

    return import_data


def test_import_data_writes_readable_strokes_and_ladders(
    tmp_path: Path, run_import: Import
) -> None:
    status, files, err = run_import(velostat={**strokes_files(), **ladder_files()})
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
    step = np.arange(1, 6)
    np.testing.assert_allclose(ladder.load_n, 0.1 * step * 9.80665, rtol=1e-3)
    np.testing.assert_allclose(ladder.resistance_ohm, 600.0 / (1 + 2.0 * step), rtol=1e-3)


@pytest.mark.slow
def test_readme_data_commands_run_on_example_clones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    readme = (Path(__file__).resolve().parents[3] / "README.md").read_text()
    (block,) = (b for b in re.findall(r"```sh\n(.*?)```", readme, re.DOTALL) if "git clone" in b)
    monkeypatch.setattr(paired, "DRAWS", 100)
    velostat = Files()
    for peak_n in (5, 11):
        # Two attempts per place, as the prior `place` requires.
        for attempt in (0, 1):
            velostat |= strokes_files(peak_n=peak_n, sensor=f"old_{peak_n}", attempt=attempt)
    clone(tmp_path / "published" / "tactile-sensor-velostat", velostat)
    clone(tmp_path / "published" / "FruitRuptureEstimate", fruit_files())
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


def test_import_data_writes_fruit_curves_and_index(tmp_path: Path, run_import: Import) -> None:
    status, files, _ = run_import(fruit=fruit_files())
    assert (status, files) == (0, {"fruit_rupture.csv.gz": 90, "fruit_rupture_index.csv": 3})
    assert (tmp_path / "data" / "fruit_rupture_index.csv").read_text().splitlines() == [
        "grasp_id,fruit,samples,rupture_force_n",
        "banana-01,banana,30,7.5",
        "kiwi-01,kiwi,30,3.5",
        "mango-01,mango,30,11",
    ]


BANANA = "banana/trainingSet/{}_1.npy"


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"README": b"no recordings"}, "contains no known recordings"),
        ({f"{PLACE}x.txt": b"1 2\n"}, "no recording for"),
        ({BANANA.format("data"): b"version https://git-lfs", BANANA.format("label"): b"x"}, "lfs"),
        (None, "not a git clone"),
    ],
)
def test_import_data_unusable_clone_prints_one_line(
    files: Files | None, message: str, run_import: Import
) -> None:
    status, _, err = run_import(clone=files)
    assert status == 2
    assert message in err.splitlines()[-1]
