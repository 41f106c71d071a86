"""Damage file: round trip, and one-line errors for invalid files and closings."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.errors import CalibrationError, InputError
from palpate.measurement import Measurement
from palpate.object.damage_file import DamageFile
from palpate.object.damage_learning import (
    FruitClosing,
    find_copies,
    find_unfit,
    follow_closing,
    learn_damage,
    read_closings,
    score_held_out,
    split_folds,
)


def squeezed(name: str, *, fruit: str = "plum", stiffness: float, limit_n: float) -> FruitClosing:
    """Squeeze a spring until it ruptures."""
    closure_mm = np.arange(0.05, 1.2 * limit_n / stiffness, 0.02)
    force_n = stiffness * closure_mm
    return follow_closing(
        name, fruit=fruit, rupture_force_n=limit_n, closure_mm=closure_mm, force_n=force_n
    )


def crate(*, plums: int, pears: int) -> list[FruitClosing]:
    """Fruit that ruptures at twice its stiffness, give or take 20 %; pears at thrice."""
    rng, made = np.random.default_rng(8), []
    for number, fruit in enumerate(["plum"] * plums + ["pear"] * pears):
        stiffness = float(np.exp(rng.normal(1.0, 0.4)))
        times = (2.0 if fruit == "plum" else 3.0) * float(np.exp(rng.normal(0.0, 0.2)))
        made.append(
            squeezed(f"g{number}", fruit=fruit, stiffness=stiffness, limit_n=times * stiffness)
        )
    return made


@cache
def made(pears: int = 25) -> DamageFile:
    closings = crate(plums=30, pears=pears)
    return DamageFile(
        model=learn_damage(closings),
        closings={"pear": 25, "plum": 30},
        learned_from={"curves.csv": "ab"},
        made_at="2026-05-04T08:00:00+00:00",
        left_out={"g99": "why"},
        held_out=score_held_out(closings),
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    made().save(tmp_path / "damage.json")
    return tmp_path / "damage.json"


def test_damage_file_roundtrip_preserves_model(path: Path) -> None:
    again, stiffness = DamageFile.load(path), Measurement(value=2.5, low=2, high=3, unit="n_per_mm")
    assert again.kinds == ("pear", "plum")
    for name in ("closings", "learned_from", "made_at", "left_out"):
        assert getattr(again, name) == getattr(made(), name)
    for kind in ("", "pear", "plum"):
        bounds_n = [one.model.bound_n(stiffness, kind=kind) for one in (again, made())]
        assert bounds_n[0] == pytest.approx(bounds_n[1], rel=1e-3)
        assert again.held_out[kind].closings == made().held_out[kind].closings
    assert again.model.rate == made().model.rate == 0.01


def renamed(document: dict[str, Any]) -> None:
    document["kinds"]["plum"]["log_force_mn"] = document["kinds"]["plum"].pop("log_force")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(version=3), "file version 3, this one reads 2"),
        (lambda d: d.update(format="palpate-calibration"), "is it a damage file?"),
        (lambda d: d.update(colour="red"), "the file has unknown keys: colour"),
        (lambda d: d.pop("kinds"), "the file lacks kinds"),
        (renamed, "kinds.plum lacks log_force and has unknown keys: log_force_mn"),
        (lambda d: d["any_kind"].update(slope="steep"), "any_kind.slope is 'steep', not a finite"),
        (lambda d: d["any_kind"].update(log_sd=0), "any_kind.log_sd is 0; it must be above 0"),
        (lambda d: d["any_kind"].update(objects=4), "has 4 closings; at least 6 are needed"),
        (lambda d: d["any_kind"].update(held_out=3), "any_kind.held_out is 3, not a table"),
        (lambda d: d.update(rate=1), "rate is 1; it must be between 0 and 1"),
        (lambda d: d["closings"].update(plum="many"), "closings.plum is 'many', not a count"),
        (lambda d: d.update(made_at=3), "made_at is 3, not text"),
    ],
)
def test_invalid_damage_file_is_refused_in_one_line(
    path: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    with pytest.raises(CalibrationError) as caught:
        DamageFile.load(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"damage file {path}: ")
    assert "\n" not in str(caught.value)


def test_load_of_version_1_keeps_its_rate(path: Path) -> None:
    document = json.loads(path.read_text()) | {"version": 1, "critical_scores": [-1.0, 0.0]}
    del document["rate"]
    path.write_text(json.dumps(document))
    assert DamageFile.load(path).model.rate == 0.001


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99, None])
def test_truncated_or_binary_damage_file_is_refused(path: Path, share: float | None) -> None:
    whole = path.read_bytes()
    path.write_bytes(b"\xff\xfe\x00" if share is None else whole[: int(share * len(whole))])
    with pytest.raises(CalibrationError, match="incomplete or invalid JSON"):
        DamageFile.load(path)


def test_check_kind_unknown_kind_message_lists_kinds() -> None:
    assert made().check_kind("plum", where="damage.json") == "plum"
    with pytest.raises(InputError, match="no kind 'apple'; available kinds: pear, plum; for"):
        made().check_kind("apple", where="damage.json")
    assert made(pears=5).kinds == ("plum",)
    with pytest.raises(InputError, match="only 25 closings of 'pear'; available kinds: plum"):
        made(pears=5).check_kind("pear", where="damage.json")


def test_copies_of_a_recording_are_in_one_fold() -> None:
    copied = [squeezed(name, stiffness=3.0, limit_n=6.0) for name in ("once", "copy")]
    other = squeezed("other", stiffness=3.0, limit_n=6.1)
    mixed = [copied[0], *crate(plums=20, pears=0), copied[1], other]
    assert find_copies(mixed) == {"copy": "once"}
    for training, test in split_folds(mixed):
        names = {closing.grasp_id for closing in test}
        assert ("copy" in names) == ("once" in names)
        assert len(training) + len(test) == len(mixed)
    assert find_unfit(mixed) == {"copy": "the same recording as once"}


@pytest.mark.parametrize(
    ("limit_n", "closing", "offset_n", "n_per_mm", "reason"),
    [
        (9.0, 1, 0.0, 2, "its curve ends at 3.98 N, before half of its rupture force"),
        (5.0, 1, 4.9, 1, "its curve begins too close to its rupture force of 5 N"),
        (3.0, -1, 0.0, 2, "its closure falls during the closing; is it a width?"),
    ],
)
def test_find_unfit_returns_reason_for_each_closing(
    limit_n: float, closing: int, offset_n: float, n_per_mm: float, reason: str
) -> None:
    along = np.arange(0.05, 2.0, 0.02)
    closure_mm, force_n = closing * along, offset_n + n_per_mm * along
    unfit = follow_closing(
        "bad", fruit="plum", rupture_force_n=limit_n, closure_mm=closure_mm, force_n=force_n
    )
    assert find_unfit([unfit, *crate(plums=3, pears=0)]) == {"bad": reason}


@pytest.mark.parametrize(
    ("curves", "index", "message"),
    [
        ("a,1,1\na,2,2\nb,1,1\na,3,3\n", "a,kiwi,3\n", "samples of a are not contiguous"),
        ("a,1,1\na,2,2\n", "a,kiwi,3\na,kiwi,3\n", "a is listed twice"),
        ("a,1,1\na,2,2\n", "a,,3\n", "the fruit of a is empty"),
    ],
)
def test_read_closings_inconsistent_files_are_refused(
    tmp_path: Path, curves: str, index: str, message: str
) -> None:
    (tmp_path / "curves.csv").write_text(f"grasp_id,closure_mm,force_n\n{curves}")
    (tmp_path / "index.csv").write_text(f"grasp_id,fruit,rupture_force_n\n{index}")
    with pytest.raises(InputError, match=message):
        read_closings(tmp_path / "curves.csv", tmp_path / "index.csv")
