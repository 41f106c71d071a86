"""Damaged or unusual files are read, or refused in one line without a traceback.

`PALPATE_FUZZ=3000` tries that many files of each kind.
"""

from __future__ import annotations

import json
import os
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.closings import write_damage_file

from palpate.calibration import Calibration
from palpate.errors import PalpateError
from palpate.holds import read_holds
from palpate.holds.recordings import read_recordings
from palpate.object.damage_file import DamageFile
from palpate.rig.file import open_file, read_rig_file
from palpate_station.sorting.rules_file import read_rules

COUNT = int(os.environ.get("PALPATE_FUZZ", "60"))
DEEP = 100_000
ODD: list[Any] = [
    None,
    True,
    -1,
    0,
    1.7e308,
    -1.7e308,
    10**400,
    "",
    "a\0b",
    "\ufeff",
    [],
    {},
    [[]],
    [[[1.0]]],
    {"": []},
    ["x"] * 3,
]
RULES = """default = "by hand"
confidence = 0.8
[[rule]]
bin = "ripe"
class = ["avocado", "mango"]
size_mm = [20.0, 70.0]
[[rule]]
bin = "rest"
ripeness = "firm"
"""
RIG = """calibration = "pad.json"
[array]
open = "palpate.rig.board_cell:no_such"
port = "/dev/null"
[gripper]
open = "palpate.rig.board_cell:no_such"
[load_cells]
newtons_per_count = [0.01, 0.02]
"""
LOG = "".join(
    f"12:34:{t // 10}.{t % 10} -> A0: {620 - t} | U: 3.{t:03d} V\n" for t in range(100, 160)
)
HOLDS = "hold_id,time_s,value\n" + "".join(f"a,{t / 10},{100 - t}\n" for t in range(30))


def replace_value(value: Any, rng: random.Random) -> Any:
    """Return a document with one unusual value."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = rng.choice(list(value))
        if rng.random() < 0.1:
            return {k: v for k, v in value.items() if k != key}
        return {**value, key: replace_value(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.8:
        place = rng.randrange(len(value))
        return [*value[:place], replace_value(value[place], rng), *value[place + 1 :]]
    return rng.choice(ODD)


def damage(text: str, rng: random.Random) -> bytes:
    """Return a text with one of several kinds of damage."""
    data, kind = bytearray(text.encode()), rng.randrange(8)
    if kind == 0:
        return bytes(data[: rng.randrange(len(data))])
    if kind == 1:
        for _ in range(rng.randrange(1, 20)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        return bytes(data)
    at = rng.randrange(len(data))
    pieces = [b"9" * 5000, b"[" * DEEP, b'{"a":' * 5000, b"\0", b"\xff\xfe", b"1e999", b"-1.7e308"]
    if kind == 2:
        return bytes(data[:at]) + rng.choice(pieces) + bytes(data[at:])
    if kind == 3:
        return b"x = " + b"[" * DEEP + b"]" * DEEP + b"\n" + bytes(data)
    if kind == 4:
        return rng.choice(pieces)
    if kind == 5:
        return b"\xef\xbb\xbf" + bytes(data)
    if kind == 6:
        words = text.split(" ")
        words[rng.randrange(len(words))] = rng.choice(["9" * 5000, "nan", "inf", '"\0"', "[[]]"])
        return " ".join(words).encode()
    try:
        odd = replace_value(json.loads(text), rng)
    except ValueError:
        return bytes(data[at:])
    # Inserted as text, because the number is too long for the JSON writer.
    return json.dumps(odd).replace(str(10**400), "9" * 400).encode()


def calibration_text() -> str:
    from palpate.rig import open_rig

    return open_rig("sim-rigid", seed=1).calibration.as_text()


READERS: dict[str, Callable[[Path], object]] = {
    "calibration.json": Calibration.load,
    "damage.json": DamageFile.load,
    "rules.toml": read_rules,
    "rig.toml": read_rig_file,
    "open.toml": lambda path: open_file(path, object_name=None, seed=0),
    "holds.csv": lambda path: list(read_holds(path)),
    "log.txt": read_recordings,
}


@pytest.fixture(scope="module")
def texts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    damage = write_damage_file(tmp_path_factory.mktemp("damage")).read_text()
    return {
        "calibration.json": calibration_text(),
        "damage.json": damage,
        "rules.toml": RULES,
        "rig.toml": RIG,
        "open.toml": RIG,
        "holds.csv": HOLDS,
        "log.txt": LOG,
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_damaged_file_is_read_or_refused_in_one_line(
    name: str, texts: dict[str, str], tmp_path: Path
) -> None:
    rng = random.Random(f"fuzz {name}")
    path, refused, lines = tmp_path / name, 0, 0
    for number in range(COUNT):
        data = damage(texts[name], rng)
        path.write_bytes(data)
        try:
            READERS[name](path)
        except (PalpateError, OSError) as error:
            refused += len(str(error).splitlines()) == 1
            lines += 1
        except BaseException as error:
            raise AssertionError(f"file {number} ({data[:80]!r}...): {error!r}") from error
    # The reader of logs accepts most damage, in rows of their own.
    assert lines == refused > COUNT // 8


@pytest.mark.parametrize("name", ["calibration.json", "damage.json", "rules.toml", "holds.csv"])
def test_file_with_byte_order_mark_is_read(
    name: str, texts: dict[str, str], tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(b"\xef\xbb\xbf" + texts[name].encode())
    assert READERS[name](path) is not None


def test_rig_files_with_circular_use_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for one, other in (("a", "b"), ("b", "a"), ("self", "self")):
        Path(f"{one}.toml").write_text(f'use = "{other}.toml"\n')
    for name in ("a", "b", "self"):
        with pytest.raises(PalpateError, match="also has a `use`; name a rig"):
            open_file(Path(f"{name}.toml"), object_name=None, seed=0)
