"""Outsiders' methods: the page's example runs in three challenges, and bad files end in a line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate_studies.baselines.constant import Constant
from palpate_studies.baselines.log_law import TunedLogLaw
from palpate_studies.baselines.pooled_law import PooledLaw
from palpate_studies.baselines.ridge import Ridge
from palpate_studies.challenge import METHODS, entered_from, judge
from palpate_studies.protocol.challenges import CHALLENGES, Challenge
from palpate_studies.protocol.method import Case, Question, losses
from palpate_studies.protocol.parts import folds

PAGE = Path(__file__).parents[2] / "docs" / "benchmark.md"


def logs(count: int = 24) -> list[Case]:
    """Holds that are an exact log law with a shift of 0.4 s, of six specimens."""
    rng = np.random.default_rng(6)
    found = []
    for number in range(count):
        time_s = np.arange(0.0, 20.1, 0.1)
        value = 100.0 - rng.uniform(2, 9) * np.log(time_s + 0.4)
        whole = np.column_stack([time_s, value])
        seen = whole[time_s <= 2.5]
        found.append(
            Case(
                question=Question(curve=seen, asked=20.0, scale=float(seen[-1, 1]), kind="x"),
                truth=float(value[-2]),
                specimen=f"s{number % 6}",
                name=f"h{number}",
                whole=whole,
            )
        )
    return found


def made_up(name: str = "settled") -> Challenge:
    cases = logs()
    parts = folds([case.specimen for case in cases], count=3)
    return Challenge(name=name, asks="made up", cases=tuple(cases), folds=tuple(parts))


def test_the_pages_example_runs_in_three_challenges(real_data: Path, tmp_path: Path) -> None:
    code = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    (tmp_path / "mine.py").write_text(code[0])
    mine = entered_from(tmp_path / "mine.py")
    for read in CHALLENGES.values():
        challenge = read(real_data)
        lost = losses(mine, challenge.cases, parts=challenge.folds)
        guess = losses(Constant(of_scale=False), challenge.cases, parts=challenge.folds)
        assert np.isfinite(lost).all()
        assert np.median(lost) < 1.2 * np.median(guess)


def test_the_log_law_finds_its_shift_on_other_specimens() -> None:
    one = made_up()
    lost = losses(TunedLogLaw(), one.cases, parts=one.folds)
    assert np.max(lost) < 1e-3
    assert np.median(losses(Constant(of_scale=True), one.cases, parts=one.folds)) > 0.005
    assert np.median(losses(Ridge(), one.cases, parts=one.folds)) < 0.005


def test_a_pooled_law_needs_no_weight_of_the_sensor() -> None:
    rng = np.random.default_rng(3)
    cases = []
    for sensor in range(4):
        excess = np.geomspace(0.01, 1.0, 10)
        whole = np.column_stack([excess, 5.0 * excess**0.8])
        for place in range(3, 10):
            question = Question(
                curve=whole[:3] * rng.uniform(0.9, 1.1), asked=excess[place], scale=1.0, kind="v"
            )
            cases.append(
                Case(
                    question=question,
                    truth=float(whole[place, 1]),
                    specimen=f"v{sensor}",
                    name=f"v{sensor}/{place}",
                    whole=whole,
                )
            )
    parts = folds([case.specimen for case in cases], count=4)
    assert np.max(losses(PooledLaw(own_gain=False), cases, parts=parts)) < 1e-6
    assert np.max(losses(PooledLaw(own_gain=True), cases, parts=parts)) > 0.01


def test_a_method_must_answer_with_a_positive_number() -> None:
    class Shy:
        name = "shy"

        def fit(self, training: object, *, choosing: object) -> object:
            return lambda question: float("nan")

    one = made_up()
    with pytest.raises(InputError, match="shy: answered nan to h0"):
        losses(Shy(), one.cases, parts=one.folds)  # type: ignore[arg-type]


def test_the_table_pairs_everyone_with_ours() -> None:
    rows = judge([made_up()], (), second=False).payload["settled"]
    assert [row["method"] for row in rows] == [method.name for method in METHODS["settled"]]
    assert rows[0]["ours_less_this"] is None
    constant = next(row for row in rows if row["method"].startswith("best constant"))
    assert constant["ours_less_this"]["verdict"] == "ours"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [(None, "no Python file"), ("x = 1", "METHOD needs a name"), ("1 / 0", "ZeroDivisionError")],
)
def test_a_file_without_a_method_is_refused_in_a_line(
    tmp_path: Path, text: str | None, complaint: str
) -> None:
    path = tmp_path / "mine.py"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=complaint):
        entered_from(path)
