"""What limits a prediction, on holds made up here."""

import gzip

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.settling.predict import METHODS
from palpate_studies import settling_limits


def _file(path, n_holds):
    rng = np.random.default_rng(1)
    time_s = np.arange(0.0, 20.3, 0.1)
    with gzip.open(path, "wt") as file:
        file.write("hold_id,time_s,value\n")
        for hold in range(n_holds):
            values = 100 - rng.uniform(1, 3) * np.log(time_s + rng.uniform(0.2, 0.6))
            for t, value in zip(time_s, values, strict=True):
                file.write(f"h{hold},{t:.1f},{value:.4f}\n")
    return path


def test_knowing_more_never_hurts_the_bayes_estimator(monkeypatch):
    monkeypatch.setattr(settling_limits, "DRAWN", 12_000)
    monkeypatch.setattr(settling_limits, "TESTED", 100)
    drawn = settling_limits.drawn_family()
    # Its answer is a posterior mean, which is best in squares.
    square = {name: [np.mean(error**2) for error in each] for name, each in drawn.items()}
    for zero_known, known, ours, waiting in zip(
        square["Bayes, family and zero known"],
        square["Bayes, family known"],
        square["relaxation"],
        square["recorded"],
        strict=True,
    ):
        assert zero_known < known < ours < waiting


def test_learners_stand_beside_ours_on_every_hold(tmp_path, monkeypatch):
    monkeypatch.setattr(settling_limits, "DRAWN", 500)
    monkeypatch.setattr(settling_limits, "TESTED", 5)
    found = settling_limits.report(_file(tmp_path / "holds.csv.gz", 24))
    real = found.payload["real_median_percent"]
    assert sum("same specimens" in name for name in real) == 4
    # On pure logarithms a line over ln(t + t0) needs no training; all must be near it.
    assert all(error < 5 for errors in real.values() for error in errors)
    panels = found.figures["settling-limits"]().axes
    # Bayes knows the family, with and without its zero; every method stands next to it.
    assert [len(panel.lines) for panel in panels] == [6, 2 + len(METHODS)]


def test_too_few_holds_are_refused(tmp_path):
    with pytest.raises(InputError, match="learners need 20"):
        settling_limits.report(_file(tmp_path / "holds.csv.gz", 3))
