"""`palpate sort --identify` and `palpate sort`, on a store and with simulated fingers."""

from __future__ import annotations

import io
import itertools
import json
import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from tests.closings import write_damage_file

from palpate.cli import build_app, run
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import Outcome
from palpate.produce.records import About, Grasp, Item, Verdict
from palpate.produce.store import Store

NOON = datetime(2026, 5, 1, 12, tzinfo=UTC)
KINDS = {"egg": (44.0, 12.0), "kiwi": (50.0, 1.5), "lime": (45.0, 3.5)}
RULES = """\
default = "by hand"

[[rule]]
bin = "strangers"
class = "unknown"

[[rule]]
bin = "kiwi"
class = "kiwi"

[[rule]]
bin = "the rest"
class = ["egg", "lime"]
"""
BY_SIZE = """\
default = "by hand"
most_grasps = 2

[[rule]]
bin = "small"
size_mm = [0, 45]

[[rule]]
bin = "large"
size_mm = [45, 80]
"""


def grasp(item_id: str, at: tuple[float, float], *, rng: np.random.Generator, n: int = 0) -> Grasp:
    size, stiffness = np.array(at) * np.exp(np.array([0.02, 0.1]) * rng.standard_normal(2))
    return Grasp(
        item_id=item_id,
        taken_at=NOON + timedelta(minutes=n),
        rig="test",
        drive="width",
        origin="twin",
        outcome=Outcome.HELD,
        measurements={
            "size_mm": Measurement(value=size, low=size - 0.4, high=size + 0.4, unit="mm"),
            "stiffness_n_per_mm": Measurement(
                value=stiffness, low=stiffness / 1.3, high=stiffness * 1.3, unit="n_per_mm"
            ),
        },
    )


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """A store with ten labelled items of each kind, and a batch of three that nobody labelled."""
    rng = np.random.default_rng(8)
    path = tmp_path / "items.sqlite"
    with Store.open(path) as kept:
        for kind, at in KINDS.items():
            for number in range(10):
                name = f"{kind}-{number}"
                kept.add_item(Item(item_id=name, kind=kind))
                kept.add_grasps([grasp(name, at, rng=rng, n=n) for n in range(2)])
        for name, at in (("K", KINDS["kiwi"]), ("E", KINDS["egg"]), ("X", (20.0, 0.5))):
            kept.add_item(Item(item_id=name, batch="crate"))
            kept.add_grasps([grasp(name, at, rng=rng, n=n) for n in range(2)])
        kept.add_item(Item(item_id="never", batch="crate"))
    return path


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    path = tmp_path / "rules.toml"
    path.write_text(RULES)
    return path


@pytest.fixture
def palpate(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    def called(*arguments: object) -> tuple[int, str, str]:
        status = run(build_app(), [str(a) for a in arguments], name="palpate")
        said = capsys.readouterr()
        return status, said.out, said.err

    return called


Palpate = Callable[..., tuple[int, str, str]]


def test_identify_names_the_kind_and_keeps_the_verdict(palpate: Palpate, store: Path) -> None:
    status, out, _ = palpate("sort", "--identify", "K", "--store", store, "--json")
    found = json.loads(out)
    assert (status, found["kind"], found["grasps"], found["simulated"]) == (0, "kiwi", 2, True)
    assert found["probability"]["kiwi"] == found["confidence"] > 0.8
    with Store.open(store) as kept:
        (verdict,) = kept.verdicts_of("K", about=About.IDENTITY)
    assert (verdict.text, verdict.explanation) == ("kiwi", found["explanation"])


def test_identify_exits_with_1_for_a_stranger(palpate: Palpate, store: Path) -> None:
    status, out, _ = palpate("sort", "--identify", "X", "--store", store)
    assert status == 1
    assert "X: unknown (simulated)" in out
    assert "Like no kind that was taught" in out


def test_identify_does_not_learn_from_the_item_itself(palpate: Palpate, store: Path) -> None:
    with Store.open(store) as kept:
        kept.add_item(Item(item_id="X", kind="kiwi"))
    status, out, _ = palpate("sort", "--identify", "X", "--store", store, "--json")
    assert (status, json.loads(out)["kind"]) == (1, "unknown")


@pytest.mark.parametrize(
    ("item", "said"),
    [
        ("nobody", "no item 'nobody'"),
        ("never", "item 'never' was never grasped; grasp it first"),
    ],
)
def test_identify_refuses_in_one_line(palpate: Palpate, store: Path, item: str, said: str) -> None:
    status, _, err = palpate("sort", "--identify", item, "--store", store)
    assert status == 2
    assert said in err
    assert err.count("\n") == 1


def test_identify_needs_what_tells_kinds_apart(palpate: Palpate, store: Path) -> None:
    slipped = Grasp(
        item_id="never",
        taken_at=NOON,
        rig="test",
        drive="width",
        origin="twin",
        outcome=Outcome.SLIPPED,
    )
    with Store.open(store) as kept:
        kept.add_grasp(slipped)
    status, _, err = palpate("sort", "--identify", "never", "--store", store)
    assert status == 2
    assert "no grasp of it measured size and stiffness" in err


def test_a_store_without_labels_says_what_to_do(palpate: Palpate, tmp_path: Path) -> None:
    path = tmp_path / "new.sqlite"
    with Store.open(path) as kept:
        kept.add_grasp(grasp("A", (44.0, 12.0), rng=np.random.default_rng(1)))
    status, _, err = palpate("sort", "--identify", "A", "--store", path)
    assert status == 2
    assert "each label needs at least 3 labelled items with a grasp; found none at all" in err


def test_few_labels_are_said_to_be_few(palpate: Palpate, tmp_path: Path) -> None:
    rng, path = np.random.default_rng(2), tmp_path / "few.sqlite"
    with Store.open(path) as kept:
        for number in range(4):
            kept.add_item(Item(item_id=f"e{number}", kind="egg"))
            kept.add_grasp(grasp(f"e{number}", KINDS["egg"], rng=rng))
        kept.add_grasp(grasp("A", KINDS["egg"], rng=rng))
    status, out, _ = palpate("sort", "--identify", "A", "--store", path)
    assert status == 0
    assert "To call anything unknown at 5 %, label 15 more items." in out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "name the --rules FILE to sort by, or the item with --identify ITEM"),
        (["--identify", "K", "--rig", "sim-rigid"], "--identify takes an item of the store alone"),
        (["--identify", "K", "--target-force-n", "5"], "--target-force-n 5.0: --identify takes"),
    ],
)
def test_sort_without_one_task_is_refused(palpate: Palpate, options: list[str], said: str) -> None:
    status, _, err = palpate("sort", *options)
    assert status == 2
    assert said in err
    assert err.count("\n") == 1


def test_sorting_a_batch_of_the_store_is_a_dry_run(
    palpate: Palpate, store: Path, rules: Path
) -> None:
    arguments = ("sort", "--rules", rules, "--store", store, "--batch", "crate")
    status, out, _ = palpate(*arguments, "--json")
    found = json.loads(out)
    assert (status, found["dry_run"]) == (0, True)
    bins = {row["item_id"]: row["bin"] for row in found["rows"]}
    assert bins == {"K": "kiwi", "E": "the rest", "X": "strangers"}
    assert found["summary"]["items_per_hour"] is None
    with Store.open(store) as kept:
        assert not kept.verdicts_of("K")
    _, out, _ = palpate(*arguments)
    assert "dry run: nothing was grasped or written; simulated" in " ".join(out.split())
    head, *rows = [line.split() for line in out.splitlines() if line.strip()]
    assert head == ["item", "bin", "probability,", "%", "reason"]
    assert any(row[:2] == ["K", "kiwi"] and row[2].isdigit() for row in rows)


def test_what_a_person_said_of_an_item_is_not_guessed(
    palpate: Palpate, store: Path, rules: Path
) -> None:
    with Store.open(store) as kept:
        kept.add_item(Item(item_id="X", kind="kiwi"))
    _, out, _ = palpate("sort", "--rules", rules, "--store", store, "--batch", "crate", "--json")
    row = next(row for row in json.loads(out)["rows"] if row["item_id"] == "X")
    assert (row["bin"], row["probability"]) == ("kiwi", 1.0)


def test_verdicts_of_the_store_decide_where_rules_ask_for_them(
    palpate: Palpate, store: Path, tmp_path: Path
) -> None:
    path = tmp_path / "bruised.toml"
    path.write_text('default = "shop"\n[[rule]]\nbin = "juice"\nbruised = true\n')
    with Store.open(store) as kept:
        kept.add_verdict(
            Verdict(
                item_id="K", about=About.BRUISE, text="bruised", probability=0.95, given_at=NOON
            )
        )
    _, out, _ = palpate("sort", "--rules", path, "--store", store, "--batch", "crate", "--json")
    bins = {row["item_id"]: row["bin"] for row in json.loads(out)["rows"]}
    assert bins == {"K": "juice", "E": "shop", "X": "shop"}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("kiwi", "pear"), "line 7: class 'pear' was not taught by 3 labelled items"),
        (('class = "kiwi"', 'class = "kiwi"\nweight = 3'), "line 10: no key 'weight' here"),
    ],
)
def test_bad_rules_are_refused(
    palpate: Palpate, store: Path, rules: Path, change: tuple[str, str], said: str
) -> None:
    rules.write_text(RULES.replace(*change))
    status, _, err = palpate("sort", "--rules", rules, "--store", store)
    assert status == 2
    assert said in err


def test_an_unknown_batch_says_so(palpate: Palpate, store: Path, rules: Path) -> None:
    status, _, err = palpate("sort", "--rules", rules, "--store", store, "--batch", "x")
    assert status == 2
    assert "batch 'x' holds no item that was grasped" in err


@pytest.mark.slow
def test_a_simulated_crate_is_grasped_and_kept(palpate: Palpate, tmp_path: Path) -> None:
    path, store = tmp_path / "size.toml", tmp_path / "crate.sqlite"
    path.write_text(BY_SIZE)
    arguments = ("sort", "--rules", path, "--rig", "sim-rigid", "--items", 2, "--seed", 3)
    status, out, _ = palpate(*arguments, "--store", store, "--batch", "b1", "--json")
    found = json.loads(out)
    assert (status, found["simulated"], found["dry_run"]) == (0, True, False)
    summary = found["summary"]
    assert summary["items"] == 2
    assert 20 < summary["items_per_hour"] < 400
    with Store.open(store) as kept:
        assert len(kept.of_batch("b1")) == 2
        for row in found["rows"]:
            grasps = kept.grasps_of(row["item_id"])
            (verdict,) = kept.verdicts_of(row["item_id"])
            assert len(grasps) == row["grasps"]
            assert (verdict.about, verdict.text) == (About.BIN, row["bin"])
            assert verdict.explanation == row["why"]
            assert row["size_mm"]["low"] < row["size_mm"]["value"]


@pytest.mark.slow
def test_a_simulated_crate_learns_from_labelled_items_of_the_store(
    palpate: Palpate, store: Path, rules: Path
) -> None:
    arguments = ("sort", "--rules", rules, "--rig", "sim-rigid", "--items", 1, "--seed", 3)
    status, out, err = palpate(*arguments, "--store", store)
    assert status == 0
    assert "teaching" not in err
    assert re.search(r"crate-3-001 +strangers", out)


@pytest.mark.slow
def test_items_before_other_fingers_are_named_line_by_line(
    palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, path, store = (tmp_path / n for n in ("rig.toml", "size.toml", "named.sqlite"))
    rig.write_text('use = "sim-rigid"\n')
    path.write_text(BY_SIZE)
    monkeypatch.setattr("sys.stdin", io.StringIO("A17\n\n\n"))
    status, out, err = palpate("sort", "--rules", path, "--rig", rig, "--store", store, "--json")
    assert status == 0
    assert "then its name" in err
    (row,) = json.loads(out)["rows"]
    assert (row["item_id"], row["belongs"]) == ("A17", None)
    with Store.open(store) as kept:
        assert kept.grasps_of("A17")


@pytest.mark.slow
def test_a_damage_file_makes_the_hand_gentler_and_a_target_firmer(
    palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, path = tmp_path / "rig.toml", tmp_path / "size.toml"
    rig.write_text('use = "sim-rigid"\n')
    path.write_text(BY_SIZE)
    limited, firm = ("--damage", write_damage_file(tmp_path)), ("--target-force-n", "9")
    peak_n = []
    for n, told in enumerate(((), limited, firm, limited + firm)):
        store = tmp_path / f"{n}.sqlite"
        monkeypatch.setattr("sys.stdin", io.StringIO("A17\n\n\n"))
        status, _, _ = palpate("sort", "--rules", path, "--rig", rig, "--store", store, *told)
        assert status == 0
        with Store.open(store) as kept:
            peak_n.append(kept.grasps_of("A17")[0].peak_force_n)
    gentle_n, limited_n, firm_n, firm_but_limited_n = peak_n
    assert 0 < limited_n < 0.9 * gentle_n
    assert gentle_n + 1.0 < firm_n < 10.0
    assert firm_but_limited_n < gentle_n


def test_how_hard_to_press_needs_a_hand(palpate: Palpate, tmp_path: Path, rules: Path) -> None:
    file = write_damage_file(tmp_path)
    for told in (("--damage", file), ("--target-force-n", "5")):
        status, _, err = palpate("sort", "--rules", rules, *told)
        assert status == 2
        assert told[0] in err
        assert "nothing is grasped; name a --rig" in err
    status, _, err = palpate("sort", "--rules", rules, "--target-force-n", "900")
    assert status == 2
    assert "force ceiling" in err


@pytest.mark.slow
def test_soft_fingers_can_not_decide_on_class_or_size(palpate: Palpate, tmp_path: Path) -> None:
    path = tmp_path / "size.toml"
    path.write_text(BY_SIZE)
    status, _, err = palpate(
        "sort", "--rules", path, "--rig", "sim-soft", "--store", tmp_path / "s.sqlite"
    )
    assert status == 2
    assert "line 4: asks for class or size, and fingers driven by pressure measure neither" in err


@pytest.mark.slow
def test_equipment_that_fails_ends_the_sorting_with_3(
    palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from palpate.errors import DeviceTimeoutError
    from palpate.twin.devices import TwinArray

    path = tmp_path / "size.toml"
    path.write_text(BY_SIZE)
    frames = itertools.count()
    read = TwinArray.read

    def dies(self: TwinArray, *, timeout_s: float) -> object:
        if self._world.seed == 500_012 and next(frames) > 90:
            # A silent sensor takes the time that it is waited for.
            self._world.clock.sleep_s(timeout_s)
            raise DeviceTimeoutError("no frame")
        return read(self, timeout_s=timeout_s)

    monkeypatch.setattr(TwinArray, "read", dies)
    status, _, err = palpate("sort", "--rules", path, "--rig", "sim-rigid", "--seed", 3)
    assert status == 3
    assert "while grasping crate-3-001 the sensor was lost; run `palpate doctor`" in err
