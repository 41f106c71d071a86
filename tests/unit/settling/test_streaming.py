"""Sample by sample: the same answers as in a batch, at a bounded cost."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.settling.predict import METHODS, method_named
from palpate.settling.result import Status
from palpate.settling.streaming import MAX_SAMPLES, SettlingStream


def holds(time_s: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(2)
    rate = np.array([[0.8], [1.5], [2.5]])
    return 20 * np.exp(-rate * time_s) - 50 + rng.normal(0, 0.05, (3, time_s.size))


def stream_of(*names: str) -> SettlingStream:
    return SettlingStream(channels=3, methods={name: method_named(name) for name in names})


def test_a_stream_gives_what_the_batch_gives() -> None:
    time_s = np.arange(60) / 15
    values = holds(time_s)
    stream = stream_of(*METHODS)
    for step in range(time_s.size):
        found = stream.push(time_s[step], values[:, step])
        if step % 12:
            continue
        for name in METHODS:
            seen = slice(0, step + 1)
            batch = method_named(name).predict(
                time_s[seen], values[:, seen], horizon_s=20.0, level=0.9
            )
            assert found[name].value == pytest.approx(batch.value, rel=1e-9)
            assert found[name].status.tolist() == batch.status.tolist()


def test_a_fast_stream_keeps_a_bounded_history_and_nearly_the_same_answer() -> None:
    time_s = np.arange(1500) / 500
    values = holds(time_s)
    lengths = []

    class Watch:
        name = "watch"

        def predict(self, times, samples, *, horizon_s, level):
            lengths.append(times.size)
            assert (np.diff(times) > 0).all()
            # Every bin is as long as the others, so that a fit weighs all times alike.
            assert np.ptp(np.diff(times[:-2])) < 1e-9 if times.size > 3 else True
            assert (samples[:, -1] == values[:, len(lengths) - 1]).all()
            return method_named("exponential").predict(
                times, samples, horizon_s=horizon_s, level=level
            )

    stream = SettlingStream(channels=3, methods={"watch": Watch()})
    for step in range(time_s.size):
        found = stream.push(time_s[step], values[:, step])
    assert max(lengths) <= MAX_SAMPLES + 2
    batch = method_named("exponential").predict(time_s, values, horizon_s=20.0, level=0.9)
    assert found["watch"].value == pytest.approx(batch.value, abs=0.1)


def test_after_the_horizon_the_estimates_stay() -> None:
    stream = SettlingStream(
        channels=3, methods={"recorded": method_named("recorded")}, horizon_s=1.0
    )
    stream.push(0.9, [1.0, 2.0, 3.0])
    assert stream.push(1.1, [7.0, 7.0, 7.0])["recorded"].value.tolist() == [1.0, 2.0, 3.0]


def test_restart_forgets() -> None:
    stream = stream_of("exponential")
    for step in range(40):
        stream.push(step / 15, [1.0 / (step + 1)] * 3)
    stream.restart()
    found = stream.push(0.0, [5.0, 6.0, 7.0])["exponential"]
    assert found.value.tolist() == [5.0, 6.0, 7.0]
    assert found.status.tolist() == [Status.TOO_SHORT] * 3


@pytest.mark.parametrize(
    ("time_s", "values", "message"),
    [
        (0.0, [1.0, 2.0, 3.0], "times must increase"),
        (1.0, [1.0, np.nan, 3.0], "not every value is a finite number"),
        (np.inf, [1.0, 2.0, 3.0], "not every value is a finite number"),
        (1.0, [1.0, 2.0], "2 values for 3 channels"),
    ],
)
def test_samples_that_cannot_be_used_are_refused_and_leave_no_trace(
    time_s: float, values: list[float], message: str
) -> None:
    stream = stream_of("recorded")
    stream.push(0.0, [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match=message):
        stream.push(time_s, values)
    assert stream.push(0.1, [4.0, 5.0, 6.0])["recorded"].value.tolist() == [4.0, 5.0, 6.0]
