"""Force of real touches: up, held, down, by sensors that the models have not seen.

The models are a clock, a static law, boosted trees, and the law of palpate. Each is learned from
training touches and returns, for a test touch, ln force at every sample with the half width of its
interval. What else it knows is `prior`: nothing, the other attempts at the same place, or the force
once in this touch.
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
from palpate.estimate.force_law import INPUTS, Population
from palpate.estimate.force_states import compute_states, log_reading
from palpate_studies.baselines.full_input_learners import make_trees
from palpate_studies.force_learning import KnownContact, interval_quantile, learn_population
from palpate_studies.protocol.paired import compare
from palpate_studies.recordings import leave_out, read_runs
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import group

PHASES = ("loading", "holding", "unloading")
#: Name of a band of force -> its ends, newtons.
BANDS = {"0.5-2": (0.5, 2.0), "2-5": (2.0, 5.0), "5-15": (5.0, 15.0), "15-": (15.0, np.inf)}
Mask: TypeAlias = NDArray[np.bool_]
#: Forces from here on are scored.
SMALLEST_N = 0.5
#: A touch whose highest conductance is less than this many times that at rest is off the sheet.
LEAST_RISE = 5.0
#: The rest reading is the median over this long, until this long before the touch; a touch is
#: followed from there.
_REST_S, _BEFORE_S = 1.0, 0.1
#: A touch begins where the reading, as `log_reading` gives it, is above this: a rise of 20 %. The
#: time since is counted in logarithms, from about a sample on.
_CONTACT, _SINCE_S = float(log_reading(0.2)), 0.01
#: Shares of the touch's 80th percentile at which the force is measured once.
FORCE_FRACTIONS = {"five_percent": 0.05, "eighty_percent": 0.8}
PRIORS = ("nothing", "place", "five_percent", "eighty_percent")
LEVEL = 0.9
#: A clock's time step: one sample of the logger.
_TICK_S = 0.007
Prediction: TypeAlias = tuple[FloatArray, FloatArray]
Rows: TypeAlias = list[dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Touch:
    """One touch.

    Attributes
    ----------
    recording_id, sensor, pin, attempt : str
        As in the file; the parts of the name.
    touch : int
        Number of the place.
    time_s : ndarray, shape (n_times,)
        Since contact.
    inputs : ndarray, shape (n_times, n_inputs)
        See `force_states`; then the highest reading so far and the time since contact.
    log_force : ndarray, shape (n_times,)
        Of the load cell; forces below 0.1 N count as that.
    phase : ndarray of str, shape (n_times,)
        As in the file.
    scored : ndarray of bool, shape (n_times,)
        In contact, with 0.5 N and more.
    measured_at : mapping of str to int
        Sample at which the force is measured once.
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
        """The key that the attempts share."""
        return (self.sensor, self.pin, self.touch)

    @property
    def weight(self) -> FloatArray:
        """Weight of each sample in a fit, as unloading is short but half the task."""
        return np.where(self.phase == "unloading", 2.0, 1.0)

    def after(self, prior: str) -> Mask:
        """Return the scored samples after the force was measured; all where it is not."""
        if prior not in self.measured_at:
            return self.scored
        return self.scored & (np.arange(len(self.scored)) > self.measured_at[prior])


def read_strokes(path: Path) -> list[Touch]:
    """Read recordings of touches and cut them.

    Raises
    ------
    InputError
        If the file can't be used or holds no touch of the sheet.
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
            raise InputError(f"{path}: recording {name!r} is not named sensor-pin-attempt")
        time_s, ohm = run["time_s"], run["resistance_ohm"]
        if (np.diff(time_s) <= 0).any() or (ohm <= 0).any():
            raise InputError(
                f"{path}: recording {name!r}: time_s must rise and resistance be above 0"
            )
        touches += _touch(name, int(run["touch"][0]), time_s, ohm, run["force_n"], run["phase"])
    if not touches:
        raise InputError(f"{path}: no touch in it raises the conductance {LEAST_RISE:g} times")
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
                prior: int(inside[np.flatnonzero(force_n[inside] >= share * high_n)[0]])
                for prior, share in FORCE_FRACTIONS.items()
            },
        )
    ]


def _touch_inputs(time_s: FloatArray, reading: FloatArray) -> FloatArray:
    """Return the states, and a contact's features: its peak and its age.

    Contact is where the reading shows it, not the load cell.
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
    """Return a follower whose interval covers the errors of its own training touches."""
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
    """Learn one force, that of the known place, or hold the measured force."""

    def middle(touches: Others) -> float:
        return float(np.median(_pool(touches, prior, lambda one: one.log_force)))

    usual = 0.0 if prior in train[0].measured_at else middle(train)

    def follow(touch: Touch, others: Others) -> FloatArray:
        known = middle(others) if prior == "place" and others else usual
        return np.full(len(touch.time_s), known + _origin(touch, prior))

    return _with_interval(follow, train, prior)


def learn_clock(train: Others, prior: str) -> Follower:
    """Learn the usual force at each time since contact, or its usual change since measured."""

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
    """Learn a power law; its gain from the place's data or this contact's."""
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
    """Return the line of least absolute error, by reweighting."""
    weight = np.ones_like(y)
    line = np.zeros(2)
    for _ in range(20):
        line = np.polyfit(x, y, 1, w=weight)
        weight = 1.0 / np.sqrt(np.maximum(np.abs(y - np.polyval(line, x)), 0.01))
    return float(line[0]), float(line[1])


def _inputs(touch: Touch, prior: str) -> FloatArray:
    """Return what a learner sees: the states, or their change since the force was measured."""
    if prior not in touch.measured_at:
        return touch.inputs
    at = touch.measured_at[prior]
    measured = np.full((len(touch.inputs), 1), touch.log_force[at])
    return np.concatenate([touch.inputs - touch.inputs[at], measured], axis=1)


def learn_trees(train: Others, prior: str) -> Follower:
    """Learn boosted trees on the same inputs; a known place adds its mean."""
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
    """Learn the population of `palpate.ForceLaw`; the place or one force updates the law."""
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
        return value, interval_quantile(LEVEL) * sd

    return follow


@lru_cache(maxsize=2)
def _population(train: tuple[Touch, ...]) -> Population:
    return learn_population([make_known_contact(one) for one in train if one.scored.sum() > 1])


def make_known_contact(touch: Touch) -> KnownContact:
    """Return a touch as what a population is learned from."""
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
    """A model's answers on the scored samples of one touch; arrays of shape (n_scored,)."""

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
        Path, typer.Option(help="Recordings of touches to learn from.", metavar="CSV")
    ],
    test_recordings: Annotated[
        Path | None,
        typer.Option(
            help="Recordings to follow; without, each sensor in turn is left out.", metavar="CSV"
        ),
    ] = None,
) -> StudyReport:
    """Follow the force of real touches from resistance, with and without a measured force.

    Example: palpate study strokes --recordings velostat_strokes.csv.gz
    """
    touches = read_strokes(recordings)
    if test_recordings is None:
        splits, how = leave_out(touches, lambda one: one.sensor), "each sensor in turn left out"
        if len(splits) < 2:
            raise InputError(
                f"{recordings}: one sensor, nothing to learn from when it is left out; "
                "give --test-recordings"
            )
    else:
        splits = [("", touches, read_strokes(test_recordings))]
        how = f"learned from, {test_recordings} followed"
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
            f"Samples of {SMALLEST_N:g} N and more; medians over samples.",
            "`ours` is `palpate.ForceLaw`, its population learned from the training touches. "
            "`place`: the other attempts at the place are known, force and reading. A static law "
            "takes its gain from them, `ours` a law of the place, the clock their usual "
            "force at each time. `five_percent`, `eighty_percent`: the force is measured once, on "
            "the way up; later samples are scored.",
            "`constant` and `clock` read no sensor. The touches are alike in time, which helps a "
            "clock, trees and the force law alike; unloading and small forces show what the "
            "sheet adds.",
        ),
        tables=[
            Table.wide(
                "Sensor left out, median |error of ln force| (coverage)",
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
    """Yield the answers of every model on the tested touches."""
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
    """Whether some place was touched more than once."""
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
                            **key,
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
    """Return our error less that of each other model, by pin of a sensor."""
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
            rows += compare(lost, pins, **key, phase=phase)
    return rows
