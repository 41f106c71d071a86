"""One flipped bit anywhere in a recording changes no answer without a word.

`PALPATE_FUZZ=500` tries that many files of each form.
"""

from __future__ import annotations

import json
import os
import random
import struct
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from mcap.opcode import Opcode
from tests.commands import Command

from palpate.recording import channels

COUNT = int(os.environ.get("PALPATE_FUZZ", "24"))
MAGIC_BYTES = 8


def records_of(content: bytes) -> dict[int, list[range]]:
    """Return the places of the records by opcode; the magic bytes are under 0."""
    found: dict[int, list[range]] = {0: [range(MAGIC_BYTES)]}
    at = MAGIC_BYTES
    while at + 9 <= len(content):
        opcode, length = struct.unpack_from("<BQ", content, at)
        found.setdefault(opcode, []).append(range(at, min(at + 9 + length, len(content))))
        at += 9 + length
    if at < len(content):
        found[0].append(range(at, len(content)))
    return found


def write_form(form: str, folder: Path, palpate: Command, monkeypatch: pytest.MonkeyPatch) -> bytes:
    """Return a recorded simulated grasp; forms: finished, without own checksum, killed."""
    with monkeypatch.context() as patched:
        if form == "older":
            # Earlier versions stored no checksum of the metadata.
            patched.setattr(channels, "_checksum", lambda texts: "")
            patched.setattr(channels, "_CHECKSUM", "later")
        path = folder / "whole.mcap"
        wishes = ("--rig", "sim-rigid", "--object", "apple", "--rate-hz", 15, "--seed", 3)
        palpate("grasp", *wishes, "--record", path)
    content = path.read_bytes()
    # Nine tenths of the file are the calibration at its begin, which every recording has.
    return content[: int(0.93 * len(content))] if form == "killed" else content


def answer_of(text: str) -> Any:
    document = json.loads(text)
    for name in ("recording", "path"):
        document.pop(name, None)
    return document


@pytest.mark.slow
@pytest.mark.parametrize("form", ["finished", "older", "killed"])
def test_flipped_bit_is_named_or_changes_no_answer(
    form: str, tmp_path: Path, palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = write_form(form, tmp_path, palpate, monkeypatch)
    path = tmp_path / "flipped.mcap"
    path.write_bytes(content)
    whole = palpate("replay", path, "--json")
    expected = answer_of(whole.out)
    assert bool(whole.err) == (form == "killed")
    rng, ended = random.Random(f"flip {form}"), Counter[str]()
    places = records_of(content)
    for number in range(COUNT):
        opcode = sorted(places)[number % len(places)]
        at = rng.choice(rng.choice(places[opcode]))
        flipped = bytearray(content)
        flipped[at] ^= 1 << rng.randrange(8)
        path.write_bytes(flipped)
        named = f"byte {at} of a record {Opcode(opcode).name if opcode else 'MAGIC'}"
        inspected, status = palpate.ended("inspect", path, "--json")
        assert (status == 0) == (inspected.err == ""), (named, inspected)
        replayed, status = palpate.ended("replay", path, "--json")
        assert "Traceback" not in replayed.err, named
        if status:
            assert (status, replayed.out, replayed.err.count("\n")) == (2, "", 1), (named, replayed)
            ended["refused"] += 1
            continue
        if form != "killed":
            assert json.loads(inspected.out)["intact"] is False, named
        assert replayed.err, named
        ended["same" if answer_of(replayed.out) == expected else "changed"] += 1
        assert replayed.err != whole.err or answer_of(replayed.out) == expected, named
    assert ended["refused"] > 0, ended
    assert ended["same"] > 0, ended
