"""`palpate sort` and `palpate sort --identify`, on a store and on simulated rigs."""

from __future__ import annotations

import io
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from packages.station.tests.cli.stored import stored_grasp
from packages.station.tests.factories import NOON
from tests.closings import write_damage_file
from tests.commands import Command

from palpate_station.records import About, Grasp, Item, Verdict
from palpate_station.store import Store

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
SIZE_RULES = """\
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
    half = {"size_mm": 0.4, "stiffness_n_per_mm": 0.26 * stiffness}
    values = {"size_mm": size, "stiffness_n_per_mm": stiffness}
    return stored_grasp(item_id, values, hours=n / 60, half=half, rig="test")


def fill_store(path: Path) -> None:
    """Write a store with ten labelled items of each kind and four unlabelled items."""
    rng = np.random.default_rng(8)
    with Store.open(path) as opened:
        for kind, at in KINDS.items():
            for number in range(10):
                name = f"{kind}-{number}"
                opened.add_item(Item(item_id=name, kind=kind))
                opened.add_grasps([grasp(name, at, rng=rng, n=n) for n in range(2)])
        for name, at in (("K", KINDS["kiwi"]), ("E", KINDS["egg"]), ("X", (20.0, 0.5))):
            opened.add_item(Item(item_id=name, batch="crate"))
            opened.add_grasps([grasp(name, at, rng=rng, n=n) for n in range(2)])
        opened.add_item(Item(item_id="never", batch="crate"))


@pytest.fixture
def store(tmp_path: Path) -> Path:
    fill_store(path := tmp_path / "items.sqlite")
    return path


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    path = tmp_path / "rules.toml"
    path.write_text(RULES)
    return path


def test_identify_prints_the_kind_and_stores_the_verdict(palpate: Command, store: Path) -> None:
    found = palpate("sort", "--identify", "K", "--store", store, "--json").document
    assert (found["kind"], found["grasps"], found["simulated"]) == ("kiwi", 2, True)
    assert found["probability"]["kiwi"] == found["confidence"] > 0.8
    with Store.open(store) as opened:
        (verdict,) = opened.verdicts_of("K", about=About.IDENTITY)
    assert (verdict.text, verdict.explanation) == ("kiwi", found["explanation"])


def test_identify_unknown_kind_does_not_learn_from_the_item_itself(
    palpate: Command, store: Path
) -> None:
    with Store.open(store) as opened:
        opened.add_item(Item(item_id="X", kind="kiwi"))
    out = palpate("sort", "--identify", "X", "--store", store, status=1).out
    assert "X: unknown (simulated)" in out


def test_identify_reports_too_few_labels(palpate: Command, tmp_path: Path) -> None:
    rng, path = np.random.default_rng(2), tmp_path / "few.sqlite"
    with Store.open(path) as opened:
        opened.add_grasp(grasp("A", KINDS["egg"], rng=rng))
    error = palpate.refused("sort", "--identify", "A", "--store", path)
    assert "needs at least 3 labelled items with a grasp; found none" in error
    with Store.open(path) as opened:
        for number in range(4):
            opened.add_item(Item(item_id=f"e{number}", kind="egg"))
            opened.add_grasp(grasp(f"e{number}", KINDS["egg"], rng=rng))
    out = palpate("sort", "--identify", "A", "--store", path).out
    assert "label 15 more items" in out


def test_sort_of_a_stored_batch_is_a_dry_run(palpate: Command, store: Path, rules: Path) -> None:
    arguments = ("sort", "--rules", rules, "--store", store, "--batch", "crate")
    found = palpate(*arguments, "--json").document
    assert found["dry_run"] is True
    bins = {row["item_id"]: row["bin"] for row in found["rows"]}
    assert bins == {"K": "kiwi", "E": "the rest", "X": "strangers"}
    assert found["summary"]["items_per_hour"] is None
    with Store.open(store) as opened:
        assert not opened.verdicts_of("K")
    out = palpate(*arguments).out
    assert "dry run" in out
    assert "simulated" in out
    # A person's label replaces the prediction, and rules use stored verdicts.
    bruise = Verdict(
        item_id="E", about=About.BRUISE, text="bruised", probability=0.95, given_at=NOON
    )
    with Store.open(store) as opened:
        opened.add_item(Item(item_id="X", kind="kiwi"))
        opened.add_verdict(bruise)
    rules.write_text(
        RULES.replace("[[rule]]", '[[rule]]\nbin = "juice"\nbruised = true\n[[rule]]', 1)
    )
    rows = {row["item_id"]: row for row in palpate(*arguments, "--json").document["rows"]}
    assert (rows["X"]["bin"], rows["X"]["probability"]) == ("kiwi", 1.0)
    assert rows["E"]["bin"] == "juice"


@pytest.mark.slow
def test_sort_grasps_a_simulated_crate_and_stores_it(palpate: Command, tmp_path: Path) -> None:
    path, store = tmp_path / "size.toml", tmp_path / "crate.sqlite"
    path.write_text(SIZE_RULES)
    arguments = ("sort", "--rules", path, "--rig", "sim-rigid", "--items", 2, "--seed", 3)
    found = palpate(*arguments, "--store", store, "--batch", "b1", "--json").document
    assert (found["simulated"], found["dry_run"]) == (True, False)
    summary = found["summary"]
    assert summary["items"] == 2
    assert 20 < summary["items_per_hour"] < 400
    with Store.open(store) as opened:
        assert len(opened.items_of_batch("b1")) == 2
        for row in found["rows"]:
            grasps = opened.grasps_of(row["item_id"])
            (verdict,) = opened.verdicts_of(row["item_id"])
            assert len(grasps) == row["grasps"]
            assert (verdict.about, verdict.text) == (About.BIN, row["bin"])
            assert verdict.explanation == row["why"]
            assert row["size_mm"]["low"] < row["size_mm"]["value"]


@pytest.mark.slow
def test_sort_by_name_has_its_force_raised_by_target_and_lowered_by_damage_file(
    palpate: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, path = tmp_path / "rig.toml", tmp_path / "size.toml"
    rig.write_text('use = "sim-rigid"\n')
    path.write_text(SIZE_RULES.replace("most_grasps = 2", "most_grasps = 1"))
    limited, firm = ("--damage", write_damage_file(tmp_path)), ("--target-force-n", "9")
    peak_n = []
    for n, options in enumerate(((), firm, limited + firm)):
        store = tmp_path / f"{n}.sqlite"
        monkeypatch.setattr("sys.stdin", io.StringIO("A17\n\n\n"))
        arguments = ("sort", "--rules", path, "--rig", rig, "--store", store, *options)
        out, err = palpate(*arguments, "--json")
        assert "enter its name" in err
        (row,) = json.loads(out)["rows"]
        assert (row["item_id"], row["belongs"]) == ("A17", None)
        with Store.open(store) as opened:
            peak_n.append(opened.grasps_of("A17")[0].peak_force_n)
    gentle_n, firm_n, firm_but_limited_n = peak_n
    assert gentle_n + 1.0 < firm_n < 10.0
    assert 0 < firm_but_limited_n < gentle_n


@pytest.mark.slow
def test_sort_equipment_failure_exits_with_3(
    palpate: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from palpate.errors import DeviceTimeoutError
    from palpate.twin.devices import TwinArray

    path = tmp_path / "size.toml"
    path.write_text(SIZE_RULES)
    frames = itertools.count()
    real_read = TwinArray.read

    def read_until_failure(self: TwinArray, *, timeout_s: float) -> object:
        if self._world.seed == 500_012 and next(frames) > 90:
            # A silent sensor delays the read until its timeout.
            self._world.clock.sleep_s(timeout_s)
            raise DeviceTimeoutError("no frame")
        return real_read(self, timeout_s=timeout_s)

    monkeypatch.setattr(TwinArray, "read", read_until_failure)
    err = palpate("sort", "--rules", path, "--rig", "sim-rigid", "--seed", 3, status=3).err
    assert "while grasping crate-3-001 the sensor was lost; run `palpate doctor`" in err
