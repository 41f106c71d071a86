"""The stroke study: cutting of touches, scored samples, and separation of test data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate_studies.protocol import paired
from palpate_studies.strokes import MODELS, PRIORS, Touch, others_of, read_strokes

HEADER = "recording_id,time_s,resistance_ohm,force_n,touch,phase\n"


def strokes_csv(
    path: Path, *, sensors: int = 2, places: int = 2, attempts: int = 2, weak: bool = False
) -> Path:
    """Write synthetic touches: two pins, some attempts, creep, and a gain per place."""
    rng, lines = np.random.default_rng(5), []
    # Fewer than 256 samples of a sensor, because the trees' bins of more are slow.
    time_s = np.arange(0, 1.0, 0.0125)
    since = time_s - 0.5
    until = [since < 0.005, since < 0.08, since < 0.3, since < 0.355]
    phase = np.select(until, ["rest", "loading", "holding", "unloading"], "rest")
    for sensor, pin in product(range(sensors), (3, 6)):
        gains = np.exp(rng.normal(0, 0.4, places))
        for attempt, place in product(range(attempts), range(places)):
            peak = rng.uniform(6, 12)
            force = np.interp(since, [0, 0.08, 0.3, 0.36], [0, peak, peak, 0])
            creep = 1 + 0.2 * np.maximum(since, 0)
            ohm = 1000 / (1 + (0.001 if weak else 8) * gains[place] * force**1.2 * creep)
            columns = zip(place * 2 + time_s, ohm, force, phase, strict=True)
            name = f"s{sensor}-{pin}mm-a{attempt}"
            lines += [f"{name},{t:.3f},{r:.4f},{f:.4f},{place},{p}" for t, r, f, p in columns]
    path.write_text(HEADER + "\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def touches(tmp_path_factory: pytest.TempPathFactory) -> list[Touch]:
    return read_strokes(strokes_csv(tmp_path_factory.mktemp("strokes") / "s.csv"))


@pytest.mark.parametrize("prior", PRIORS)
def test_follower_uses_reference_force_only_where_measured(
    touches: list[Touch], prior: str
) -> None:
    """Changing all unmeasured forces of a test touch does not change the predictions."""
    train = [one for one in touches if one.sensor == "s0"]
    touch = next(one for one in touches if one.sensor == "s1")
    others = others_of(touch, touches)
    hidden = np.full_like(touch.log_force, 4.0)
    if prior in touch.measured_at:
        hidden[touch.measured_at[prior]] = touch.log_force[touch.measured_at[prior]]
    blind = replace(touch, log_force=hidden)
    for name in ("constant", "clock", "static", "ours"):
        follow = MODELS[name](train, prior)
        assert follow(blind, others)[0].tolist() == follow(touch, others)[0].tolist(), name


@pytest.mark.slow
def test_study_prints_one_document(
    tmp_path: Path, document: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("sklearn")
    monkeypatch.setattr(paired, "DRAWS", 100)
    path = strokes_csv(tmp_path / "s.csv")
    found = document("strokes", "--recordings", path)
    asked = {(row["model"], row["told"]) for row in found["summary"]}
    assert {(model, "eighty_percent") for model in MODELS} <= asked
    assert {("ours", told) for told in PRIORS} <= asked
    # These four keys identify a row of the summary.
    keys = [tuple(one[k] for k in ("model", "told", "phase", "band")) for one in found["summary"]]
    assert len(keys) == len(set(keys))
    error = {
        (one["model"], one["told"]): one["median_abs_log_error"]
        for one in found["summary"]
        if (one["phase"], one["band"]) == ("all", "all")
    }
    assert error["ours", "place"] < 0.5 * error["constant", "place"]
    assert error["ours", "eighty_percent"] < 0.5 * error["constant", "eighty_percent"]


@pytest.mark.parametrize(
    ("made", "message"),
    [
        ({"weak": True}, "no touch raises the conductance"),
        ({"sensors": 1}, "none is left for training"),
    ],
)
def test_strokes_study_of_unusable_recordings_is_refused(
    made: dict[str, Any], message: str, tmp_path: Path, refusal: Callable[..., str]
) -> None:
    path = strokes_csv(tmp_path / "s.csv", **made)
    assert message in refusal("strokes", "--recordings", path)


@pytest.mark.slow
def test_strokes_with_test_recordings_scores_only_these_and_priors_of_their_attempts(
    tmp_path: Path, document: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(paired, "DRAWS", 100)
    known = strokes_csv(tmp_path / "known.csv", sensors=1)
    tested = strokes_csv(tmp_path / "tested.csv", sensors=1, places=3, attempts=1)
    tested.write_text(tested.read_text().replace("\ns0-", "\nnew-"))
    rows = document("strokes", "--recordings", known, "--test-recordings", tested)["rows"]
    assert {row["recording_id"].split("-")[0] for row in rows} == {"new"}
    assert {row["touch"] for row in rows} == {0, 1, 2}
    # With one attempt per place, no other touch of the place can be given.
    assert {row["told"] for row in rows} == {*PRIORS} - {"place"}
