"""Training and test sets are separate, and differences are paired."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import PalpateError
from palpate_studies.protocol.paired import difference_of_pairs
from palpate_studies.protocol.parts import Learned, SeenBeforeError
from palpate_studies.rupture import RULE, apply_policy
from palpate_studies.second.closings import other_closings


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


def test_apply_policy_on_training_fruit_raises() -> None:
    fruit = other_closings(seed=3)[:24]
    with pytest.raises(SeenBeforeError, match="used for fitting or choosing"):
        apply_policy(RULE, [(fruit, fruit[:3])])
