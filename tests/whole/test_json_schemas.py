"""What `--json` prints is what the published schemas in `docs/schemas` describe, and no more."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from referencing import Registry, Resource
from tests.closings import write_damage_file

from palpate.cli import build_app, run

ROOT = Path(__file__).resolve().parents[2]
SCHEMAS: dict[str, Any] = {
    path.name: json.loads(path.read_text(encoding="utf-8"))
    for path in sorted((ROOT / "docs" / "schemas").glob("*.json"))
}
REGISTRY: Registry[Any] = Registry().with_resources(
    (name, Resource.from_contents(schema)) for name, schema in SCHEMAS.items()
)
#: What the commands below read.
FILES = (
    "demo force",
    "demo recordings",
    "grasp --seed 3 --object strawberry --rate-hz 15 --record g.mcap",
    "grasp --seed 2 --rate-hz 15 --item A1",
    "calibrate force --rig sim-rigid --out pad-force.json",
)
#: Schema and a command whose output it describes.
COMMANDS = (
    ("grasp", "grasp --object strawberry --seed 3 --rate-hz 15"),
    ("grasp", "grasp --object kiwi --rate-hz 15 --damage damage.json --kind kiwi"),
    ("grasp", "grasp --rig sim-soft --rate-hz 15 --seed 2 --item A1"),
    ("replay", "replay g.mcap"),
    ("frames", "replay g.mcap --frames"),
    ("inspect", "inspect g.mcap"),
    ("doctor", "doctor --rig sim-rigid"),
    ("ports", "ports"),
    ("pattern", "pattern --preset paper-3x2 --out sensor"),
    ("settle", "settle demo-recordings"),
    ("settle", "settle demo-recordings/ohm.csv --until-half-width 9"),
    ("force", "force demo-force/weights.csv --adc-bits 10"),
    ("force", "force demo-force/presses.csv --adc-bits 10"),
    ("items", "items"),
    ("item", "items A1"),
    ("items", "items --store demo-packhouse/palpate-items.sqlite"),
    ("item", "items fruit-3 --store demo-packhouse/palpate-items.sqlite"),
    ("ripeness", "ripeness --batch Monday --store demo-packhouse/palpate-items.sqlite"),
    ("identify", "sort --identify fruit-1 --store demo-packhouse/palpate-items.sqlite"),
    (
        "sort",
        "sort --rules demo-packhouse/rules.toml --batch Monday "
        "--store demo-packhouse/palpate-items.sqlite",
    ),
    ("sort", "sort --rules demo-packhouse/by-size.toml --rig sim-rigid --items 2 --taught 3"),
    ("bruise", "bruise A17 --store demo-packhouse/palpate-items.sqlite"),
    ("calibrate-rest", "calibrate rest --rig sim-rigid --out pad.json"),
    ("calibrate-force", "calibrate force --rig sim-rigid --seed 1 --out pad-1.json"),
    ("calibrate-compliance", "calibrate compliance --rig sim-rigid --out pad-force.json"),
    ("calibrate-damage", "calibrate damage --curves curves.csv --index index.csv --out other.json"),
)


@pytest.fixture(scope="module")
def folder(packhouse: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what the commands read."""
    path = tmp_path_factory.mktemp("json")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(path)
        patch.delenv("PALPATE_STORE", raising=False)
        for command in FILES:
            assert run(build_app(), command.split(), name="palpate") == 0
        write_damage_file(path)
        shutil.copytree(packhouse, "demo-packhouse")
    return path


def faults(name: str, document: object) -> list[str]:
    checker = Draft202012Validator(SCHEMAS[f"{name}.json"], registry=REGISTRY)
    return [f"{list(fault.path)}: {fault.message}" for fault in checker.iter_errors(document)]


@pytest.mark.parametrize("name", SCHEMAS)
def test_json_schemas_are_valid(name: str) -> None:
    Draft202012Validator.check_schema(SCHEMAS[name])


def test_json_schemas_all_have_a_tested_command() -> None:
    # `state` is what the dashboard reports: see the tests of its API.
    assert {name for name, _ in COMMANDS} | {"measurement", "state"} == {
        name.removesuffix(".json") for name in SCHEMAS
    }


@pytest.mark.slow
@pytest.mark.parametrize(("name", "command"), COMMANDS)
def test_command_output_matches_its_json_schema(
    name: str,
    command: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.delenv("PALPATE_STORE", raising=False)
    run(build_app(), [*command.split(), "--json"], name="palpate")
    assert faults(name, json.loads(capsys.readouterr().out)) == []


def test_json_schema_rejects_unknown_field() -> None:
    assert faults("ports", {"ports": [], "more": 1})
    assert faults("ports", {"ports": [{"device": 1}]})
