"""Write docs/results.md: the main tables of every study, each with the command that makes all.

Usage: python docs/generate_results.py [FOLDER_OF_REAL_RECORDINGS]

Without the folder, studies of real recordings are left out of the page and named as missing.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

#: Studies on the twin, then those on real recordings with their options.
SIMULATED = (
    ("table1", "--families"),
    ("table2",),
    ("table3",),
    ("springs",),
    ("table4",),
    ("table5",),
    ("environment",),
    ("fatigue",),
    ("noise",),
    ("detection-limit",),
    ("speed",),
)
REAL = (
    (
        "realism",
        "--ladders=velostat_force_ladders.csv",
        "--presses=velostat_presses.csv.gz",
        "--holds=holds_velostat.csv.gz",
        "--holds=holds_cbsilicone.csv.gz",
    ),
    (
        "settled",
        "--holds=holds_cbsilicone.csv.gz",
        "--holds=holds_force_relaxation.csv.gz",
        "--holds=holds_velostat.csv.gz",
        "--holds=holds_food.csv.gz",
        "--holds=holds_tape.csv.gz",
    ),
    ("force-ladders", "--ladders=velostat_force_ladders.csv"),
    (
        "presses",
        "--recordings=velostat_presses.csv.gz",
    ),
    ("histories", "--recordings=silicone_histories.csv.gz"),
    ("rupture", "--curves=fruit_rupture.csv.gz", "--index=fruit_rupture_index.csv"),
    ("rupture-limits", "--curves=fruit_rupture.csv.gz", "--index=fruit_rupture_index.csv"),
)
#: Study -> the tables shown, by the beginning of their title (after a file's name), and the rows of
#: them, by the beginning; every table has all its rows where none are named.
SHOWN: dict[str, dict[str, tuple[str, ...]]] = {
    "table1": {"Family": ()},
    "table2": {"Settled": ()},
    "table3": {
        "R^2": ("in a fixture, placed again each time | largest", "laid anywhere, once | largest")
    },
    "springs": {"R^2": tuple(f"closed by {step} mm | mean" for step in (1, 2, 3))},
    "table4": {"Level lab": ()},
    "table5": {
        "Error": tuple(
            f"{level} | {way} s"
            for level in ("lab", "field")
            for way in (
                *(f"recorded, {cutoff_s}" for cutoff_s in ("2.5", "10", "20")),
                *(f"{way}, 2.5" for way in ("exponential", "ours", "ours, own holds")),
            )
        )
    },
    "environment": {"Spread": ()},
    "fatigue": {"Drift": ()},
    "noise": {
        "Level field": tuple(
            f"{rate} Hz, {chain} |"
            for rate in (250, 15)
            for chain in ("no filter", "median of 5", "median of 5, notch")
        )
    },
    "detection-limit": {"Weakest": ()},
    "speed": {"Median": ("3 |", "6 |", "25 |")},
    "realism": {"holds_velostat": ()},
    "settled": {"Median |error|, %": (), "Regret": ()},
    "force-ladders": {"New sensor": ("mean of ladders",)},
    "presses": {"Force after": ("all",)},
    "histories": {"RMS": ("resistance",)},
    "rupture": {"Firmness": ("all",)},
    "rupture-limits": {"Firmness": ("all",)},
}
#: Beginnings of the paragraphs of a report that the page keeps: what the data are, and what was an
#: input. The command prints the others.
KEPT_WORDS = (
    "Simulated",
    "Real",
    "Published",
    "Marked",
    "Missed",
    "Drawn",
    "Kinder",
    "No published",
)
#: `palpate` of this interpreter, installed or not on the path.
RUN = "import sys; from palpate.cli import main; sys.exit(main())"
PAGE = Path(__file__).with_name("results.md")


def section(arguments: tuple[str, ...], *, folder: Path) -> str:
    """Run one study and return its part of the page."""
    command = ["palpate", "study", *arguments]
    with tempfile.TemporaryDirectory() as out:
        subprocess.run(
            [sys.executable, "-c", RUN, *command[1:], "--out", out],
            cwd=folder,
            check=True,
            stdout=subprocess.DEVNULL,
        )
        (report,) = Path(out).glob("*.md")
        title, *rest = report.read_text().strip().split("\n")
    body = "\n".join(rest).strip()
    return f"#{title}\n\n`{' '.join(command)}`\n\n{shortened(arguments[0], body)}\n"


def shortened(study: str, body: str) -> str:
    """Return of a study's report what the data are, and those of its tables that are shown."""
    words, *tables = re.split(r"\n\n(?=\*\*)", body)
    shown = [one for one in words.split("\n\n") if one.startswith(KEPT_WORDS)]
    left_out = 0
    for table in tables:
        title, _, lines = table.partition("\n\n")
        head, rule, *rows = lines.splitlines()
        bare = re.sub(r"^\S+\.(csv|gz):? ", "", title.strip("*"))
        wanted = next(
            (
                starts
                for start, starts in SHOWN.get(study, {"": ()}).items()
                if bare.startswith(start) or title.strip("*").startswith(start)
            ),
            None,
        )
        kept = (
            []
            if wanted is None
            else [
                row
                for row in rows
                if not wanted or row.startswith(tuple(f"| {one}" for one in wanted))
            ]
        )
        left_out += len(rows) - len(kept)
        if kept:
            shown += [title, "\n".join([head, rule, *kept])]
    if left_out:
        shown.append(f"The command prints {left_out} more rows.")
    return "\n\n".join(shown)


def main() -> None:
    """Write the page."""
    real = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else None
    parts = [
        "# Results\n\nOne table of each study, generated by `python docs/generate_results.py`; do "
        "not edit. The command above a table prints all of it, with notes and further tables; "
        "`--out DIR` adds figures (`--format pdf`, `svg` or `png`, `--dpi N`). Results on the twin "
        "are simulated, at its levels `lab` and `field`. The [scoreboard](scoreboard.md) has the "
        "claims with their strongest rivals. "
        "Elsewhere: [every kind of hold](prediction.md), [stiffness, staircases](force.md), "
        "[grasping](grasp-produce.md), [size and slip](size-slip.md), "
        "[ripeness](ripeness.md), [bruises](bruise.md), [sorting](sort.md).\n"
    ]
    parts += [section(arguments, folder=Path.cwd()) for arguments in SIMULATED]
    if real is None:
        missing = ", ".join(arguments[0] for arguments in REAL)
        parts.append(f"Not run, for want of the real recordings: {missing}.\n")
    else:
        parts += [section(arguments, folder=real) for arguments in REAL]
    PAGE.write_text("\n".join(parts))


if __name__ == "__main__":
    main()
