"""Evaluation of an archive with one and with two processes: time and memory.

    python benchmarks/archive.py --samples 100000000 --folder /big/disk

The archive contains drawn holds (no sensor, no twin) of 2000 samples at 100 Hz that creep with the
logarithm of time, in files of a million rows. `palpate archive settle` runs on them with one and
with two processes. The peak is the largest memory of one process. The results must be identical.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow as pa

from palpate_archive.evaluating import create_settle_job, perform, plan_tasks
from palpate_archive.layout import Archive, Part

PER_HOLD, HOLDS_PER_FILE = 2000, 500


def draw_holds(root: Path, *, samples: int) -> None:
    """Write an archive of drawn holds."""
    archive, rng = Archive(root, create=True), np.random.default_rng(3)
    time_s = np.arange(PER_HOLD) / 100
    for number in range(max(samples // (PER_HOLD * HOLDS_PER_FILE), 1)):
        fall = rng.uniform(100.0, 600.0, (HOLDS_PER_FILE, 1))
        start_s = rng.uniform(0.1, 1.0, (HOLDS_PER_FILE, 1))
        values = 9000.0 - fall * np.log(time_s + start_s)
        values += rng.normal(0.0, 3.0, values.shape)
        names = [f"h{number}-{hold}" for hold in range(HOLDS_PER_FILE)]
        columns = {
            "recording": np.full(values.size, f"r{number}"),
            "hold_id": np.repeat(names, PER_HOLD),
            "time_s": np.tile(time_s, HOLDS_PER_FILE),
            "value": values.ravel(),
            "channel": np.full(values.size, "mean"),
            "unit": np.full(values.size, "ohm"),
        }
        part = Part(kind="holds", station="drawn", date="2026-01-01", name=f"p{number:04}")
        archive.write(part, [pa.table(columns)], sources=[f"s{number}"])


def settle(root: Path, results: Path, *, workers: int) -> dict[str, float]:
    """Evaluate the archive; return seconds and peak memory, GB."""
    tasks = plan_tasks(
        create_settle_job(method="relaxation", horizon_s=19.0), Archive(root), to=results
    )
    started_s = time.perf_counter()
    perform(tasks, show=lambda _: None, workers=workers)
    taken_s = time.perf_counter() - started_s
    peaks = [
        resource.getrusage(who).ru_maxrss
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    ]
    return {"seconds": taken_s, "peak_gb": max(peaks) / 1e6}


def hash_results(results: Path) -> str:
    """Return a hash of the bytes of all results."""
    files = sorted(results.rglob("*.parquet"))
    found = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
    return hashlib.sha256("".join(found).encode()).hexdigest()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=10_000_000)
    parser.add_argument("--folder", type=Path, help="folder for the temporary archive")
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        root, results, workers = options.one
        print(json.dumps(settle(Path(root), Path(results), workers=int(workers))))
        return
    folder = Path(tempfile.mkdtemp(dir=options.folder))
    try:
        draw_holds(folder / "archive", samples=options.samples)
        prints = set()
        for workers in (1, 2):
            results = folder / f"results-{workers}"
            command = [sys.executable, __file__, "--one", str(folder / "archive"), str(results)]
            ended = subprocess.run(
                [*command, str(workers)], capture_output=True, text=True, check=True
            )
            found = json.loads(ended.stdout)
            prints.add(hash_results(results))
            rate = options.samples / found["seconds"] / 1e6
            print(
                f"{workers} process(es): {found['seconds']:.1f} s, {rate:.2f} million "
                f"samples/s, peak of one process {found['peak_gb']:.2f} GB",
                flush=True,
            )
        print("identical results" if len(prints) == 1 else "DIFFERENT results")
        sys.exit(len(prints) != 1)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
