"""Requests to a running grasp from another thread."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.requests import Requests
from palpate.grasp.result import Outcome
from palpate.grasp.state import GraspState


def test_stop_request_ends_grasp_at_present_position(plan: Plan, bench: Any) -> None:
    requests, widths = Requests(), list[float]()

    def watcher(grasp_state: GraspState) -> None:
        if grasp_state.estimate.now_s > 4.0 and not requests.stop.is_set():
            requests.stop.set()
            widths.append(bench.width_mm)

    result = bench.grasp(plan, requests=requests, watchers=[watcher])
    assert result.outcome is Outcome.STOPPED
    assert bench.width_mm == widths[0] < 74.0


def test_release_request_before_measurement_opens_with_stopped(plan: Plan, bench: Any) -> None:
    requests = Requests()

    def watcher(grasp_state: GraspState) -> None:
        if grasp_state.phase is Phase.SQUEEZE:
            requests.release.set()

    result = bench.grasp(plan, requests=requests, watchers=[watcher])
    assert (result.outcome, bench.width_mm) == (Outcome.STOPPED, 74.0)


def test_release_request_during_hold_ends_with_held(plan: Plan, bench: Any) -> None:
    requests = Requests()

    def watcher(grasp_state: GraspState) -> None:
        if (
            grasp_state.phase is Phase.HOLD
            and grasp_state.estimate.now_s - grasp_state.since_s > 3.0
        ):
            requests.release.set()

    result = bench.grasp(replace(plan, hold_s=60.0), requests=requests, watchers=[watcher])
    assert (result.outcome, bench.width_mm) == (Outcome.HELD, 74.0)
    held = {moment.name: moment.time_s for moment in result.moments}
    assert 3.0 < held["held"] - held["answer"] < 3.5
