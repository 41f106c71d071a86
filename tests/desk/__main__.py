"""Run the desk bench and print its table: `python -m tests.desk --help`."""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from threading import Lock
from typing import Any

from tests.desk import bench, rigs
from tests.desk.bench import GUARDS, Case
from tests.desk.busy import keep_busy

#: Boards and their rates, hands, and ways of use.
BOARDS = ("firmware-15", "firmware-50", "firmware-250", "text-15", "text-50", "text-250")
MORE_BOARDS = ("text-60", "flexitac-100")
HANDS = ("dynamixel", "feetech", "servo", "own")
_QUIET = "quiet"
#: Desks at a time of the shortened bench: two processors are then busy for three quarters of the
#: time.
_SHORT_JOBS = 6
_COLUMNS = (
    "use", "board", "hand", "load", "held", "touch s", "answer s", "age ms", "peak N", "total s",
    "world late ms", "port late ms",
)  # fmt: skip


def list_cases(
    uses: Iterable[str], boards: Iterable[str], hands: Iterable[str], *, count: int, **options: Any
) -> list[Case]:
    """Return the cases of all pairs; a hobby servo needs palpate's firmware."""
    return [
        Case(
            use=use,
            board=kind,
            rate_hz=float(rate),
            hand=hand,
            index=index,
            **options,
        )
        for use in uses
        for kind, rate in (board.split("-") for board in boards)
        for hand in hands
        if hand != "servo" or kind == "firmware"
        for index in range(count)
    ]


def plan_full() -> list[Case]:
    """Return the cases of `make desk`."""
    return [
        *list_cases(["grasp"], BOARDS, HANDS, count=20),
        *list_cases(["grasp"], MORE_BOARDS, ["dynamixel"], count=20),
        *list_cases(["grasp"], BOARDS, HANDS, count=20, busy=2),
        *list_cases(["grasp"], BOARDS, HANDS, count=10, reply_s=0.016),
        *list_cases(["grasp"], BOARDS, HANDS, count=10, burst_s=0.016),
        *list_cases(["grasp"], BOARDS, ["dynamixel"], count=10, reply_s=0.0002),
        *list_cases(["python"], BOARDS, ["dynamixel"], count=20),
        *list_cases(GUARDS, BOARDS, ["dynamixel"], count=2),
    ]


def plan_short() -> list[Case]:
    """Return the cases of `make desk-short`: three grasps of each pair of board and hand."""
    return list_cases(["grasp"], BOARDS, HANDS, count=3)


def run_cases(
    cases: Sequence[Case], *, jobs: int, file: Path | None, known: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Run the cases that are not known yet, those with as many busy processes together."""
    done = list(known)
    seen = {json.dumps(run["case"], sort_keys=True) for run in known}
    for board in {case.board for case in cases}:
        rigs.calibrate(board)
    writing = Lock()

    def run_pair(pair: Sequence[Case]) -> None:
        for run in bench.run_cases(pair):
            with writing:
                done.append(run.to_dict())
                print(describe(done[-1]), flush=True)
                if file is not None:
                    with file.open("a", encoding="utf-8") as lines:
                        lines.write(json.dumps(done[-1]) + "\n")

    by_load = defaultdict[int, dict[Case, list[Case]]](lambda: defaultdict(list))
    for case in cases:
        if json.dumps(asdict(case), sort_keys=True) not in seen:
            by_load[case.busy][replace(case, index=0)].append(case)
    for busy, pairs in by_load.items():
        with keep_busy(busy), ThreadPoolExecutor(jobs) as pool:
            list(pool.map(run_pair, pairs.values()))
    return done


def describe(run: dict[str, Any]) -> str:
    """Return a line for a run."""
    case = run["case"]
    return (
        f"{case['use']} {case['board']}-{case['rate_hz']:g} {case['hand']} {_load(case)} "
        f"#{case['index']}: {run['reason'] or run['outcome']}, peak {run['peak_n']:.2f} N, "
        f"{run['total_s']:.1f} s, port at most {1e3 * run['world']['port_latest_s']:.0f} ms late"
    )


def _key(case: dict[str, Any]) -> tuple[str, str, str, str]:
    """Return the first columns of a case."""
    return case["use"], f"{case['board']} {case['rate_hz']:g} Hz", case["hand"], _load(case)


def _load(case: dict[str, Any]) -> str:
    parts = [f"{case['busy']} busy"] * bool(case["busy"])
    parts += [f"replies {1e3 * case['reply_s']:g} ms"] * (case["reply_s"] != 0.001)
    parts += [f"bursts {1e3 * case['burst_s']:g} ms"] * bool(case["burst_s"])
    return ", ".join(parts) or _QUIET


def _median(values: Iterable[float | None], *, scale: float = 1.0, worst: bool = False) -> str:
    found = [value * scale for value in values if value is not None]
    if not found:
        return "-"
    return f"{max(found) if worst else statistics.median(found):.2f}"


def format_table(runs: Sequence[dict[str, Any]]) -> str:
    """Return the table: a row for each pair and load, then the reasons of the failures."""
    groups = defaultdict[tuple[str, str, str, str], list[dict[str, Any]]](list)
    for run in runs:
        groups[_key(run["case"])].append(run)
    rows = [_COLUMNS]
    for key, group in groups.items():
        passed = sum(not run["reason"] for run in group)
        rows.append(
            (
                *key,
                f"{passed}/{len(group)}",
                _median(run["touch_s"] for run in group),
                _median(run["answer_s"] for run in group),
                _median((run["age_s"] for run in group), scale=1e3, worst=True),
                _median((run["peak_n"] for run in group), worst=True),
                _median(run["total_s"] for run in group),
                _median((run["world"]["latest_s"] for run in group), scale=1e3, worst=True),
                _median((run["world"]["port_latest_s"] for run in group), scale=1e3, worst=True),
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    failures = defaultdict[tuple[tuple[str, str, str, str], str], int](int)
    for key, group in groups.items():
        for run in group:
            if run["reason"]:
                failures[key, run["reason"]] += 1
    lines += [""] + [
        f"{count} x {' '.join(key)}: {reason}" for (key, reason), count in failures.items()
    ]
    return "\n".join(lines)


def find_failing_groups(runs: Sequence[dict[str, Any]]) -> list[str]:
    """Return the pairs below the bar.

    The bar is 19 of 20 on a quiet desk, and 18 of 20 with busy processes, slow replies or bursts.
    A session of Python and a guard never fail.
    """
    groups = defaultdict[tuple[str, str, str, str], list[dict[str, Any]]](list)
    for run in runs:
        groups[_key(run["case"])].append(run)
    below = []
    for key, group in groups.items():
        failed = sum(bool(run["reason"]) for run in group)
        allowed = len(group) // (20 if key[3] == _QUIET else 10) * (key[0] == "grasp")
        if failed > allowed:
            below.append(f"{' '.join(key)}: {len(group) - failed} of {len(group)}")
    return below


def find_short_failures(runs: Sequence[dict[str, Any]]) -> list[str]:
    """Return what is below the bar of the shortened bench.

    Its desks load the machine, so its bar is that of a busy one: 18 of 20 in all, and no pair that
    never held.
    """
    groups = defaultdict[tuple[str, str, str, str], list[bool]](list)
    for run in runs:
        groups[_key(run["case"])].append(not run["reason"])
    below = [f"{' '.join(key)}: never" for key, held in groups.items() if not any(held)]
    passed = sum(map(sum, groups.values()))
    if passed < 0.9 * len(runs):
        below.append(f"{passed} of {len(runs)} in all")
    return below


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(prog="python -m tests.desk", description=__doc__)
    whole = parser.add_mutually_exclusive_group()
    whole.add_argument("--full", action="store_true", help="all cases of `make desk`")
    whole.add_argument("--short", action="store_true", help="three grasps of each pair")
    parser.add_argument(
        "--uses", nargs="+", default=["grasp"], choices=["grasp", "python", *GUARDS]
    )
    parser.add_argument("--boards", nargs="+", default=BOARDS, choices=[*BOARDS, *MORE_BOARDS])
    parser.add_argument("--hands", nargs="+", default=HANDS, choices=HANDS)
    parser.add_argument("--grasps", type=int, default=3, metavar="N", help="runs of each pair")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="busy processes")
    parser.add_argument("--reply-ms", type=float, default=1.0, help="delay of the hand's replies")
    parser.add_argument("--burst-ms", type=float, default=0.0, help="timer of the board's adapter")
    parser.add_argument("--jobs", type=int, metavar="N", help="desks at a time")
    parser.add_argument("--json", type=Path, metavar="FILE", help="runs; known ones are skipped")
    given = parser.parse_args()
    if given.full:
        cases = plan_full()
    elif given.short:
        cases = plan_short()
    else:
        cases = list_cases(
            given.uses,
            given.boards,
            given.hands,
            count=given.grasps,
            busy=given.busy,
            reply_s=given.reply_ms / 1e3,
            burst_s=given.burst_ms / 1e3,
        )
    known = []
    if given.json is not None and given.json.exists():
        known = [json.loads(line) for line in given.json.read_text(encoding="utf-8").splitlines()]
    jobs = given.jobs or (_SHORT_JOBS if given.short else 1)
    runs = run_cases(cases, jobs=jobs, file=given.json, known=known)
    print(format_table(runs))
    below = find_short_failures(runs) if given.short else find_failing_groups(runs)
    failed = sum(bool(run["reason"]) for run in runs)
    print(f"\n{len(runs) - failed} passed, {failed} failed")
    if below:
        print("Below the bar:", *below, sep="\n  ")
    sys.exit(bool(below))


if __name__ == "__main__":
    main()
