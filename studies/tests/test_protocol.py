"""Training and test sets are separate, and differences are paired."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import PalpateError
from palpate.estimate.damage_learning import FruitClosing, follow_closing
from palpate_studies.protocol.paired import difference_of_pairs
from palpate_studies.protocol.parts import Learned, SeenBeforeError
from palpate_studies.rupture import RATES, RULE, apply_policy, stop_fractions, tradeoff


def pears(count: int, *, seed: int) -> list[FruitClosing]:
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        stiffness = rng.uniform(2.0, 8.0)
        closure_mm = np.arange(0.0, 4.0, 0.02)
        found.append(
            follow_closing(
                f"p{number}",
                fruit="pear",
                rupture_force_n=float(2.0 * stiffness * np.exp(0.2 * rng.standard_normal())),
                closure_mm=closure_mm,
                force_n=stiffness * closure_mm,
            )
        )
    return found


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
    fruit = pears(24, seed=1)
    with pytest.raises(SeenBeforeError, match="used for fitting or choosing"):
        apply_policy(RULE, [(fruit, fruit[:3])])


def test_apply_policy_settings_do_not_depend_on_test_fruit() -> None:
    training, test = pears(60, seed=1), pears(30, seed=2)
    whole, part = (apply_policy(RULE, [(training, some)]) for some in (test, test[:5]))
    assert part.settings == pytest.approx(whole.settings[:5])
    assert stop_fractions(part, test[:5]) == pytest.approx(stop_fractions(whole, test)[:5])
    assert np.all(np.diff(whole.settings[0]) >= 0)
    rows = [row for row in tradeoff([whole], closings=test) if row["fruit"] == "all"]
    assert [row["rate_limit"] for row in rows] == list(RATES)
    # At a nominal 10 %, more than 9 of 30 rupture with a probability of only 0.2 %.
    assert rows[-1]["ruptured"] <= 9
