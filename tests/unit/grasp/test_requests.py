"""Requests to a running grasp from another thread."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.requests import Requests
from palpate.grasp.result import Outcome
from palpate.grasp.state import GraspState


def holds_for_3_s(state: GraspState) -> bool:
    return state.phase is Phase.HOLD and state.estimate.now_s - state.since_s > 3.0


@pytest.mark.parametrize(
    ("wish", "is_due", "outcome"),
    [
        ("stop", lambda state: state.estimate.now_s > 4.0, Outcome.STOPPED),
        ("release", lambda state: state.phase is Phase.SQUEEZE, Outcome.STOPPED),
        ("release", holds_for_3_s, Outcome.HELD),
    ],
)
def test_request_stops_in_place_or_opens(
    plan: Plan, bench: Any, wish: str, is_due: Callable[[GraspState], bool], outcome: Outcome
) -> None:
    requests, widths = Requests(), list[float]()

    def watcher(state: GraspState) -> None:
        if is_due(state) and not widths:
            getattr(requests, wish).set()
            widths.append(bench.width_mm)

    result = bench.grasp(plan, hold_s=60.0, requests=requests, watchers=[watcher])
    assert result.outcome is outcome
    assert widths[0] < 74.0
    assert bench.width_mm == (widths[0] if wish == "stop" else 74.0)
    if outcome is Outcome.HELD:
        held = {moment.name: moment.time_s for moment in result.moments}
        assert 3.0 < held["held"] - held["answer"] < 3.5


def test_stop_requested_together_with_a_release_leaves_the_hand_in_place(
    plan: Plan, bench: Any
) -> None:
    requests, widths = Requests(), list[float]()

    def watcher(state: GraspState) -> None:
        if state.phase is Phase.HOLD and not widths:
            requests.release.set()
            requests.stop.set()
            widths.append(bench.width_mm)

    bench.grasp_until(Outcome.STOPPED, plan, hold_s=60.0, requests=requests, watchers=[watcher])
    assert bench.width_mm == widths[0] < 74.0
