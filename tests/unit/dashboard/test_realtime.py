"""The devices' process before all others, where that is allowed."""

from __future__ import annotations

import multiprocessing
import multiprocessing.synchronize
import os
from pathlib import Path

import pytest

from palpate.cli import build_app
from palpate.commands.outcome import run
from palpate.dashboard.realtime import check_realtime, put_first
from palpate.errors import InputError


def may() -> bool:
    try:
        check_realtime()
    except InputError:
        return False
    return True


def wait(gate: multiprocessing.synchronize.Event) -> None:
    gate.wait()


def test_a_process_comes_first_or_the_refusal_says_what_is_missing() -> None:
    context = multiprocessing.get_context("spawn")
    gate = context.Event()
    process = context.Process(target=wait, args=(gate,))
    process.start()
    assert process.pid is not None
    try:
        if may():
            put_first(process.pid)
            assert os.sched_getscheduler(process.pid) == os.SCHED_RR
        else:
            with pytest.raises(InputError, match="ulimit -r"):
                put_first(process.pid)
            assert os.sched_getscheduler(process.pid) == os.SCHED_OTHER
    finally:
        gate.set()
        process.join()


def test_asking_leaves_this_process_as_it_was() -> None:
    may()
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_without_the_right_to_it_serve_ends_before_it_opens_anything(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    options = ["serve", "--port", "0", "--realtime", "--folder", str(tmp_path / "data")]
    assert run(build_app(), options, name="palpate") == 2
    assert "rtprio" in capsys.readouterr().err
    assert not (tmp_path / "data").exists()


def test_where_the_system_has_no_such_thing_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_setscheduler")
    with pytest.raises(InputError, match="needs Linux"):
        check_realtime()
