"""Force of real touches (loading, holding, unloading) on held-out sensors.

The models are a constant, a clock, a static law, boosted trees, and the force law of palpate. Each
model is trained on other touches and predicts ln force with the half width of its interval at every
sample of a test touch. The prior information is either nothing, the other attempts at the same
place, or one measured force of the touch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from numpy.typing import NDArray

from palpate import ForceLaw
from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.force.force_law import INPUTS, Population
from palpate.force.force_states import compute_states, log_reading
from palpate.measurement import half_width_sds
from palpate_studies.baselines.full_input_learners import make_trees
from palpate_studies.force_learning import KnownContact, learn_population
from palpate_studies.protocol.paired import compare
from palpate_studies.recordings import leave_out, read_runs
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import group

PHASES = ("loading", "holding", "unloading")
#: Name of a band of force -> its ends, newtons.
BANDS = {"0.5-2": (0.5, 2.0), "2-5": (2.0, 5.0), "5-15": (5.0, 15.0), "15-": (15.0, np.inf)}
Mask: TypeAlias = NDArray[np.bool_]
#: Smallest scored force.
SMALLEST_N = 0.5
#: Smallest ratio of the highest conductance of a touch to the rest; other touches missed the sheet.
LEAST_RISE = 5.0
#: The rest reading is the median over `_REST_S`, ending `_BEFORE_S` before the touch; the touch
#: includes this rest.
_REST_S, _BEFORE_S = 1.0, 0.1
#: Reading at contact (`log_reading` of a 20 % rise), and offset of the logarithm of the time since
#: contact.
_CONTACT, _SINCE_S = float(log_reading(0.2)), 0.01
#: Fractions of the touch's 80th percentile at which the force is measured once.
FORCE_FRACTIONS = {"five_percent": 0.05, "eighty_percent": 0.8}
PRIORS = ("nothing", "place", "five_percent", "eighty_percent")
LEVEL = 0.9
#: Time step of the clock: one sample of the logger.
_TICK_S = 0.007
Prediction: TypeAlias = tuple[FloatArray, FloatArray]
Rows: TypeAlias = list[dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Touch:
    """One touch.

    Attributes
    ----------
    recording_id, sensor, pin, attempt : str
        Name in the file, and its parts.
    touch : int
        Number of the place.
    time_s : ndarray, shape (n_times,)
        Time since contact.
    inputs : ndarray, shape (n_times, n_inputs)
        States of `force_states`, the highest reading so far, and the time since contact.
    log_force : ndarray, shape (n_times,)
        Logarithm of the load cell's force, which is clipped to at least 0.1 N.
    phase : ndarray of str, shape (n_times,)
        Phase in the file.
    scored : ndarray of bool, shape (n_times,)
        Samples in contact with at least 0.5 N.
    measured_at : mapping of str to int
        Prior -> sample at which the force is measured once.
    """

    recording_id: str
    sensor: str
    pin: str
    attempt: str
    touch: int
    time_s: FloatArray
    inputs: FloatArray
    log_force: FloatArray
    phase: NDArray[np.str_]
    scored: Mask
    measured_at: dict[str, int]

    @property
    def place(self) -> tuple[str, str, int]:
        """Key of the place, shared by its attempts."""
        return (self.sensor, self.pin, self.touch)

    @property
    def weight(self) -> FloatArray:
        """Weight of each sample in a fit; unloading is short and gets twice the weight."""
        return np.where(self.phase == "unloading", 2.0, 1.0)

    def after(self, prior: str) -> Mask:
        """Return a mask of the scored samples, after the measured force if any."""
        if prior not in self.measured_at:
            return self.scored
        return self.scored & (np.arange(len(self.scored)) > self.measured_at[prior])


def read_strokes(path: Path) -> list[Touch]:
    """Read recordings of touches.

    Raises
    ------
    InputError
        If the file can't be used or contains no touch of the sheet.
    """
    touches: list[Touch] = []
    for run in read_runs(
        path,
        keys=("recording_id", "touch"),
        text=("recording_id", "phase"),
        numbers=("time_s", "resistance_ohm", "force_n", "touch"),
    ):
        name = str(run["recording_id"][0])
        if name.count("-") < 2:
            raise InputError(
                f"{path}: recording {name!r}: the name must have the form sensor-pin-attempt"
            )
        time_s, ohm = run["time_s"], run["resistance_ohm"]
        if (np.diff(time_s) <= 0).any() or (ohm <= 0).any():
            raise InputError(
                f"{path}: recording {name!r}: time_s must increase and resistances be positive"
            )
        touches += _touch(name, int(run["touch"][0]), time_s, ohm, run["force_n"], run["phase"])
    if not touches:
        raise InputError(f"{path}: no touch raises the conductance by a factor of {LEAST_RISE:g}")
    return touches


def _touch(
    name: str,
    number: int,
    time_s: FloatArray,
    ohm: FloatArray,
    force_n: FloatArray,
    phase: NDArray[np.str_],
) -> list[Touch]:
    touched = np.flatnonzero(phase != "rest")
    if not len(touched):
        return []
    since_s = time_s - time_s[touched[0]]
    resting = (since_s < -_BEFORE_S) & (since_s > -_BEFORE_S - _REST_S)
    if not resting.any():
        return []
    rest_ohm = float(np.median(ohm[resting]))
    if rest_ohm / ohm[touched].min() < LEAST_RISE:
        return []
    used = since_s > -_BEFORE_S - _REST_S
    since_s, ohm, force_n, phase = since_s[used], ohm[used], force_n[used], phase[used]
    inside = np.flatnonzero(phase != "rest")
    high_n = float(np.percentile(force_n[inside], 80))
    sensor, pin, attempt = name.rsplit("-", 2)
    return [
        Touch(
            recording_id=name,
            sensor=sensor,
            pin=pin,
            attempt=attempt,
            touch=number,
            time_s=since_s,
            inputs=_touch_inputs(since_s, log_reading(rest_ohm / ohm - 1)),
            log_force=np.log(np.maximum(force_n, 0.1)),
            phase=phase,
            scored=(phase != "rest") & (force_n >= SMALLEST_N),
            measured_at={
                prior: int(inside[np.flatnonzero(force_n[inside] >= fraction * high_n)[0]])
                for prior, fraction in FORCE_FRACTIONS.items()
            },
        )
    ]


def _touch_inputs(time_s: FloatArray, reading: FloatArray) -> FloatArray:
    """Return the states, the highest reading so far, and the time since contact.

    Contact is detected from the reading, not from the load cell.
    """
    shown = np.flatnonzero(reading > _CONTACT)
    contact_s = time_s[shown[0]] if len(shown) else time_s[-1]
    lasting = np.log(np.maximum(time_s - contact_s, 0.0) + _SINCE_S)
    states = compute_states(time_s, reading)
    return np.column_stack([states, np.maximum.accumulate(reading), lasting])


Others: TypeAlias = Sequence[Touch]
#: From a touch and the other attempts at its place to a prediction.
Follower: TypeAlias = Callable[[Touch, Others], Prediction]
Learner: TypeAlias = Callable[[Others, str], Follower]


def others_of(touch: Touch, touches: Others) -> list[Touch]:
    """Return the other attempts at the place of a touch."""
    return [one for one in touches if one.place == touch.place and one is not touch]


def _origin(touch: Touch, prior: str) -> float:
    return float(touch.log_force[touch.measured_at[prior]]) if prior in touch.measured_at else 0.0


def _pool(touches: Others, prior: str, each: Callable[[Touch], FloatArray]) -> FloatArray:
    return np.concatenate([each(one)[one.after(prior)] for one in touches])


def _with_interval(
    follow: Callable[[Touch, Others], FloatArray], train: Others, prior: str
) -> Follower:
    """Return a follower whose interval is calibrated on the training errors."""
    errors = [
        np.abs(follow(one, others_of(one, train)) - one.log_force)[one.after(prior)]
        for one in train
    ]
    half = float(np.quantile(np.concatenate(errors), LEVEL))
    return lambda touch, others: (
        (value := follow(touch, others)),
        np.full(value.shape, half),
    )


def learn_constant(train: Others, prior: str) -> Follower:
    """Learn a constant force: over all touches, of the place, or the measured force."""

    def middle(touches: Others) -> float:
        return float(np.median(_pool(touches, prior, lambda one: one.log_force)))

    usual = 0.0 if prior in train[0].measured_at else middle(train)

    def follow(touch: Touch, others: Others) -> FloatArray:
        known = middle(others) if prior == "place" and others else usual
        return np.full(len(touch.time_s), known + _origin(touch, prior))

    return _with_interval(follow, train, prior)


def learn_clock(train: Others, prior: str) -> Follower:
    """Learn the median force over time since contact, or since the measured force."""

    def ticks(touch: Touch) -> FloatArray:
        start = touch.time_s[touch.measured_at[prior]] if prior in touch.measured_at else 0.0
        return np.round((touch.time_s - start) / _TICK_S)

    def table(touches: Others) -> tuple[FloatArray, FloatArray]:
        tick = _pool(touches, prior, ticks)
        force = _pool(touches, prior, lambda one: one.log_force - _origin(one, prior))
        seen = np.unique(tick)
        return seen, np.array([np.median(force[tick == one]) for one in seen])

    usual = table(train)

    def follow(touch: Touch, others: Others) -> FloatArray:
        known = table(others) if prior == "place" and others else usual
        return np.asarray(np.interp(ticks(touch), *known)) + _origin(touch, prior)

    return _with_interval(follow, train, prior)


def learn_static_law(train: Others, prior: str) -> Follower:
    """Learn a power law, with the gain from the place or the measured force."""
    reading = _pool(train, "nothing", lambda one: one.inputs[:, 0])
    force = _pool(train, "nothing", lambda one: one.log_force)
    slope, offset = _absolute_line(reading, force)

    def follow(touch: Touch, others: Others) -> FloatArray:
        value = slope * touch.inputs[:, 0] + offset
        if prior in touch.measured_at:
            at = touch.measured_at[prior]
            return np.asarray(value + touch.log_force[at] - value[at])
        if prior == "place" and others:
            left = _pool(others, prior, lambda one: one.log_force - slope * one.inputs[:, 0])
            return np.asarray(value + float(np.median(left)) - offset)
        return np.asarray(value)

    return _with_interval(follow, train, prior)


def _absolute_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Fit a line with least absolute error by iterative reweighting."""
    weight = np.ones_like(y)
    line = np.zeros(2)
    for _ in range(20):
        line = np.polyfit(x, y, 1, w=weight)
        weight = 1.0 / np.sqrt(np.maximum(np.abs(y - np.polyval(line, x)), 0.01))
    return float(line[0]), float(line[1])


def _inputs(touch: Touch, prior: str) -> FloatArray:
    """Return the states, or their change since the measured force and that force."""
    if prior not in touch.measured_at:
        return touch.inputs
    at = touch.measured_at[prior]
    measured = np.full((len(touch.inputs), 1), touch.log_force[at])
    return np.concatenate([touch.inputs - touch.inputs[at], measured], axis=1)


def learn_trees(train: Others, prior: str) -> Follower:
    """Learn boosted trees on the same inputs; a known place adds its means."""
    machine = make_trees(
        loss="absolute_error", max_iter=100, max_leaf_nodes=15, min_samples_leaf=40
    )

    def list_inputs(touch: Touch, others: Others) -> FloatArray:
        inputs = _inputs(touch, prior)
        if prior != "place":
            return inputs
        known = others or [touch]
        reading = np.mean(_pool(known, prior, lambda one: one.inputs[:, 0]))
        force = np.mean(_pool(known, prior, lambda one: one.log_force))
        more = np.full((len(inputs), 1), force if others else np.nan)
        return np.concatenate([inputs, inputs[:, :1] - reading, more], axis=1)

    x = np.concatenate([list_inputs(one, others_of(one, train))[one.after(prior)] for one in train])
    y = _pool(train, prior, lambda one: one.log_force - _origin(one, prior))
    w = _pool(train, prior, lambda one: one.weight)
    machine.fit(x, y, sample_weight=w)
    return _with_interval(
        lambda touch, others: machine.predict(list_inputs(touch, others)) + _origin(touch, prior),
        train,
        prior,
    )


def learn_force_law(train: Others, prior: str) -> Follower:
    """Learn the population of `palpate.ForceLaw`; place or measured force update the law."""
    population = _population(tuple(train))

    def follow(touch: Touch, others: Others) -> Prediction:
        law = ForceLaw(population)
        if prior == "place" and others:
            law = ForceLaw.fit(
                _pool(others, prior, lambda one: one.inputs[:, :INPUTS]),
                force_n=np.exp(_pool(others, prior, lambda one: one.log_force)),
                contact=[one.attempt for one in others for _ in range(one.scored.sum())],
                population=population,
            )
        if prior in touch.measured_at:
            at = touch.measured_at[prior]
            law.update(touch.inputs[at, :INPUTS], force_n=np.exp(touch.log_force[at]))
        value, sd = law.log_force(touch.inputs[:, :INPUTS])
        return value, half_width_sds(LEVEL) * sd

    return follow


@lru_cache(maxsize=2)
def _population(train: tuple[Touch, ...]) -> Population:
    return learn_population([make_known_contact(one) for one in train if one.scored.sum() > 1])


def make_known_contact(touch: Touch) -> KnownContact:
    """Return a touch as training data of a population."""
    used = np.flatnonzero(touch.scored)
    given = np.flatnonzero(used == touch.measured_at["eighty_percent"])
    return KnownContact(
        inputs=touch.inputs[used, :INPUTS],
        force_n=np.exp(touch.log_force[used]),
        weight=touch.weight[used],
        place=touch.place,
        given=int(given[0]) if len(given) else None,
    )


MODELS: Mapping[str, Learner] = {
    "constant": learn_constant,
    "clock": learn_clock,
    "static": learn_static_law,
    "trees": learn_trees,
    "ours": learn_force_law,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScoredStrokes:
    """A model's errors on the scored samples of one touch; arrays of shape (n_scored,)."""

    model: str
    prior: str
    touch: Touch
    log_force: FloatArray
    error: FloatArray
    covered: Mask
    phase: NDArray[np.str_]


def report(
    *,
    recordings: Annotated[
        Path, typer.Option(help="Training recordings of touches.", metavar="CSV")
    ],
    test_recordings: Annotated[
        Path | None,
        typer.Option(
            help="Test recordings; by default each sensor in turn is held out.", metavar="CSV"
        ),
    ] = None,
) -> StudyReport:
    """Track the force of real touches from resistance, with and without a measured force.

    Example: palpate study strokes --recordings velostat_strokes.csv.gz
    """
    touches = read_strokes(recordings)
    if test_recordings is None:
        splits, how = leave_out(touches, lambda one: one.sensor), "each sensor in turn held out"
        if len(splits) < 2:
            raise InputError(
                f"{recordings}: only one sensor, so none is left for training; give "
                "--test-recordings"
            )
    else:
        splits = [("", touches, read_strokes(test_recordings))]
        how = f"used for training, and {test_recordings} for the test"
    scored = [one for _, train, tested in splits for one in _score(train, tested)]
    summary = _summary(scored)
    columns = {"all": ("all", "all"), "unloading": ("unloading", "all")}
    columns |= {f"{band} N": ("all", band) for band in BANDS}
    names = {place: head for head, place in columns.items()}
    return StudyReport(
        name="strokes",
        title="Force of real Velostat under short touches",
        provenance=(
            f"Real recordings with a load cell, {len(touches)} touches, {how}. "
            f"Samples of at least {SMALLEST_N:g} N; medians over samples.",
            "`palpate` is `palpate.ForceLaw` with a population learned from the training touches. "
            "`place`: forces and readings of the other attempts at the place are known. They "
            "determine the gain of the static law, a law of the place for `palpate`, and the "
            "median force over time for the clock. `five_percent`, `eighty_percent`: the force is "
            "measured once during loading, and later samples are scored.",
            "`constant` and `clock` use no sensor. All touches have a similar course in time, "
            "which helps clock, trees and force law equally; unloading and small forces show the "
            "contribution of the sheet.",
        ),
        tables=[
            Table.wide(
                "Held-out sensors, median |error of ln force| (coverage)",
                [
                    row | {"part": names[row["phase"], row["band"]]}
                    for row in summary
                    if (row["phase"], row["band"]) in names
                ],
                {"known": "{told}", "model": "{model}"},
                over="part",
                form="{median_abs_log_error:.3f} ({coverage:.2f})",
            )
        ],
        payload={
            "rows": _rows(scored),
            "summary": summary,
            "compared": _compare_models(scored),
            "level": LEVEL,
        },
    )


command = as_command(report)


def _score(train: Others, tested: Others) -> Iterator[ScoredStrokes]:
    """Yield the predictions of every model and prior for the test touches."""
    for prior in PRIORS:
        if prior == "place" and not (_are_repeated(train) and _are_repeated(tested)):
            continue
        for model, learn in MODELS.items():
            follow = learn(train, prior)
            for touch in tested:
                used, others = touch.after(prior), others_of(touch, tested)
                if not used.any() or (prior == "place" and not others):
                    continue
                value, half = follow(touch, others)
                error = np.abs(value - touch.log_force)[used]
                yield ScoredStrokes(
                    model=model,
                    prior=prior,
                    touch=touch,
                    log_force=touch.log_force[used],
                    error=error,
                    covered=error <= half[used],
                    phase=touch.phase[used],
                )


def _are_repeated(touches: Others) -> bool:
    """Return whether some place was touched more than once."""
    return len({one.place for one in touches}) < len(touches)


def _rows(scored: Sequence[ScoredStrokes]) -> Rows:
    """Return medians over the samples of each touch, by phase and by band of force."""
    rows: Rows = []
    for one in scored:
        force_n = np.exp(one.log_force)
        for phase in PHASES:
            for band, (low, high) in BANDS.items():
                mine = (one.phase == phase) & (force_n >= low) & (force_n < high)
                if mine.any():
                    rows.append(
                        {
                            "recording_id": one.touch.recording_id,
                            "touch": one.touch.touch,
                            "model": one.model,
                            "told": one.prior,
                            "phase": phase,
                            "band": band,
                            **_figures(one.error[mine], one.covered[mine]),
                        }
                    )
    return rows


def _summary(scored: Sequence[ScoredStrokes]) -> Rows:
    """Return medians over samples of all sensors, by phase and by band of force."""
    summary: Rows = []
    for key, mine in group(scored, "model", "prior"):
        error, covered, phases, log_force = (
            np.concatenate([getattr(one, name) for one in mine])
            for name in ("error", "covered", "phase", "log_force")
        )
        force_n = np.exp(log_force)
        for phase in ("all", *PHASES):
            for band, (low, high) in {"all": (0.0, np.inf), **BANDS}.items():
                here = (force_n >= low) & (force_n < high)
                here &= (phases == phase) | (phase == "all")
                if here.any():
                    summary.append(
                        {
                            "model": key["model"],
                            "told": key["prior"],
                            "phase": phase,
                            "band": band,
                            **_figures(error[here], covered[here]),
                        }
                    )
    return summary


def _figures(error: FloatArray, covered: Mask) -> dict[str, Any]:
    return {
        "samples": len(error),
        "median_abs_log_error": round(float(np.median(error)), 5),
        "coverage": round(float(np.mean(covered)), 5),
    }


def _compare_models(scored: Sequence[ScoredStrokes]) -> Rows:
    """Compare the error of `ours` with each other model, with pins as specimens."""
    rows: Rows = []
    for key, some in group(scored, "prior"):
        for phase in ("all", "unloading"):
            lost: dict[str, FloatArray] = {}
            for name, mine in group(some, "model"):
                chosen = [one.error[(one.phase == phase) | (phase == "all")] for one in mine]
                lost[name["model"]] = np.concatenate(chosen)
            pins = [
                f"{one.touch.sensor}-{one.touch.pin}"
                for one in some
                if one.model == "ours"
                for _ in range(int(np.sum((one.phase == phase) | (phase == "all"))))
            ]
            rows += compare(lost, pins, told=key["prior"], phase=phase)
    return rows
