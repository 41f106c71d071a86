"""Detection of contact, slip and removal."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.signal.events import ContactState, watch_contact

TIME_S = np.arange(0, 10, 1 / 15)
#: A finger's change: contact at 2 s, -50 %, release at 8 s.
HELD = np.where((TIME_S >= 2) & (TIME_S < 8), -50 * (1 - 0.3 * np.exp(-(TIME_S - 2) / 2)), 0.0)


def contact_events(percent: np.ndarray) -> list[tuple[float, str]]:
    """Return time and kind of the events of a finger."""
    events, state = [], ContactState()
    for now_s, change in zip(TIME_S, percent, strict=False):
        state, kind = watch_contact(state, float(change))
        if kind is not None:
            events.append((float(now_s), kind.value))
    return events


def test_watch_contact_detects_contact_and_removal_at_once() -> None:
    events = contact_events(HELD)
    assert [kind for _, kind in events] == ["contact", "removal"]
    assert 2.0 <= events[0][0] <= 2.2
    assert 8.0 <= events[1][0] <= 8.2
    # Later samples do not change an event.
    assert contact_events(HELD[:100]) == events[:1]


@pytest.mark.parametrize(
    ("percent", "kinds"),
    [
        (np.where(TIME_S >= 5, 0.55, 1.0) * HELD, ["contact", "slip", "removal"]),
        (np.where(TIME_S >= 2, -50 * np.exp(-(TIME_S - 2) / 20), 0.0), ["contact"]),
        (np.where((TIME_S > 2.65) & (TIME_S < 2.85), np.nan, HELD), ["contact", "removal"]),
        (np.zeros(TIME_S.size), []),
    ],
    ids=["partial loss", "slow relaxation", "NaN", "nothing"],
)
def test_watch_contact_detects_only_a_fast_loss_as_slip(
    percent: np.ndarray, kinds: list[str]
) -> None:
    assert [kind for _, kind in contact_events(percent)] == kinds


def test_watch_contact_with_noise_at_the_threshold_does_not_chatter() -> None:
    noisy = -10 + np.random.default_rng(0).normal(scale=1.0, size=TIME_S.size)
    assert len(contact_events(noisy)) <= 1
