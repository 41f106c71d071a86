"""Separate training and test sets, paired differences, and the study of `palpate qualify`."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import PalpateError
from palpate.grasp.result import GraspResult, Outcome
from palpate_station.qualify import agreement
from palpate_studies.protocol.paired import difference_of_pairs
from palpate_studies.protocol.parts import Learned, SeenBeforeError
from palpate_studies.qualify import FIGURES, Pool, check_coverage
from palpate_studies.stoppable import require_uninterrupted


def test_learned_on_training_specimens_raises() -> None:
    chosen = Learned(found=0.2, seen=frozenset({"a", "b"}))
    assert chosen.on(["c"]) == 0.2
    with pytest.raises(SeenBeforeError, match="b was used"):
        chosen.on(["b", "c"])
    assert issubclass(SeenBeforeError, PalpateError)


def test_paired_difference_cancels_difficulty_of_specimens() -> None:
    rng = np.random.default_rng(3)
    hard = np.repeat(rng.uniform(1.0, 20.0, 30), 4)
    names = [str(k) for k in np.repeat(np.arange(30), 4)]
    rival = hard + 0.5 + 0.1 * rng.standard_normal(hard.size)
    found = difference_of_pairs(hard, rival, names, statistic=np.mean)
    assert found.verdict == "ours"
    assert found.low < -0.5 < found.high
    assert found.high - found.low < 0.1
    assert difference_of_pairs(rival, hard, names, statistic=np.mean).verdict == "rival"
    assert difference_of_pairs(hard, hard, names).verdict == "undecided"
    assert difference_of_pairs([1.0], [2.0], ["a"]).to_dict()["low"] is None
    with pytest.raises(ValueError, match="not finite"):
        difference_of_pairs([np.nan, 1.0], [1.0, 1.0], ["a", "b"])


def test_stopped_grasp_ends_the_study() -> None:
    held = GraspResult(outcome=Outcome.HELD)
    assert require_uninterrupted(held) is held
    with pytest.raises(KeyboardInterrupt):
        require_uninterrupted(GraspResult(outcome=Outcome.STOPPED))


@pytest.mark.slow
def test_check_coverage_of_good_instrument_covers_true_figures(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(agreement, "_DRAWS", 100)
    random = np.random.default_rng(1)
    truth = random.normal(1.0, 0.6, 80)
    pool = Pool(truth=truth, grasps=truth[:, None] + random.normal(0.0, 0.1, (80, 2)))
    rows = check_coverage(pool, level="lab", campaigns=10)
    assert {row["figure"] for row in rows} <= set(FIGURES)
    assert all(row["coverage"] >= 0.6 for row in rows)
