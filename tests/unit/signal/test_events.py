"""Detection of contact, slip and removal."""

from __future__ import annotations

import numpy as np

from palpate.signal.events import (
    ContactState,
    watch_contact,
)

TIME_S = np.arange(0, 10, 1 / 15)


def contact_events(time_s: np.ndarray, finger_percent: np.ndarray) -> list[tuple[float, str, int]]:
    """Return the events of all fingers."""
    events, states = [], [ContactState()] * finger_percent.shape[1]
    for now_s, changes in zip(time_s, finger_percent, strict=True):
        for finger, change in enumerate(changes):
            states[finger], kind = watch_contact(states[finger], float(change))
            if kind is not None:
                events.append((float(now_s), kind.value, finger))
    return events


def kinds(events: list[tuple[float, str, int]]) -> list[tuple[str, int]]:
    return [(kind, finger) for _, kind, finger in events]


def grasp() -> np.ndarray:
    """Return a finger's change: contact at 2 s, -50 %, release at 8 s."""
    held = (TIME_S >= 2) & (TIME_S < 8)
    return np.where(held, -50 * (1 - 0.3 * np.exp(-(TIME_S - 2) / 2)), 0.0)


def test_watch_contact_detects_contact_and_removal_per_finger() -> None:
    fingers = np.stack([grasp(), np.zeros_like(TIME_S)], axis=1)
    events = contact_events(TIME_S, fingers)
    assert kinds(events) == [("contact", 0), ("removal", 0)]
    assert 2.0 <= events[0][0] <= 2.2
    assert 8.0 <= events[1][0] <= 8.2


def test_watch_contact_detects_a_partial_loss_as_slip() -> None:
    slipped = np.where(TIME_S >= 5, 0.55, 1.0) * grasp()
    assert kinds(contact_events(TIME_S, slipped[:, None])) == [
        ("contact", 0),
        ("slip", 0),
        ("removal", 0),
    ]


def test_watch_contact_does_not_detect_slow_relaxation_as_slip() -> None:
    slow = np.where(TIME_S >= 2, -50 * np.exp(-(TIME_S - 2) / 20), 0.0)
    assert kinds(contact_events(TIME_S, slow[:, None])) == [("contact", 0)]


def test_watch_contact_with_noise_at_the_threshold_does_not_chatter() -> None:
    noisy = -10 + np.random.default_rng(0).normal(scale=1.0, size=(TIME_S.size, 1))
    assert len(contact_events(TIME_S, noisy)) <= 1


def test_watch_contact_ignores_nan_samples() -> None:
    signal = grasp()[:, None].copy()
    signal[40:43] = np.nan
    assert kinds(contact_events(TIME_S, signal)) == [("contact", 0), ("removal", 0)]


def test_watch_contact_events_do_not_depend_on_later_samples() -> None:
    fingers = np.stack([grasp(), 0.5 * grasp()], axis=1)
    cut = 100
    before = [event for event in contact_events(TIME_S, fingers) if event[0] < TIME_S[cut]]
    assert contact_events(TIME_S[:cut], fingers[:cut]) == before
