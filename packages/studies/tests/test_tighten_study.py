"""The study of holds that tighten at a slip."""

from __future__ import annotations

import pytest

from palpate_studies import tighten


@pytest.mark.slow
def test_study_counts_drops_reactions_and_false_slips() -> None:
    """Two elastic loads, of each level, at 60 frames/s; two quiet holds."""
    seeds = (tighten.FIRST_SEED - 6, tighten.FIRST_SEED - 5)
    rows = [
        tighten.load_object(seed, rate_hz=60.0, tighten=times) for times in (0, 3) for seed in seeds
    ]
    alarms = [tighten.count_quiet_slips(tighten.FIRST_QUIET - n, rate_hz=15.0) for n in (1, 2)]
    report = tighten.judge(rows, alarms, quiet_rate_hz=15.0).document
    without, with_it = report["summary"]
    assert (without["load"], without["objects"], without["dropped"]) == ("elastic", 2, 2)
    assert without["reacted"] == 0
    assert with_it["reacted"] == 2
    assert 0.0 < with_it["command_s"] < with_it["reaction_s"] < 0.2
    assert [row["false"] for row in report["quiet"]] == [0, 0]
