"""Force of a hydrogel sensor in a robot's force loop, with each recording held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from palpate import ForceLaw
from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.force.force_law import INPUTS
from palpate.force.force_states import compute_states, log_reading
from palpate.measurement import half_width_sds
from palpate_studies.baselines.full_input_learners import make_trees
from palpate_studies.force_learning import KnownContact, learn_population
from palpate_studies.recordings import leave_out, read_runs
from palpate_studies.report import StudyReport, Table, as_command

LEVEL = 0.9
#: Smallest scored force, newtons, and smallest number of scored samples of a contact.
SMALLEST_N, LEAST_SAMPLES = 0.5, 20
#: The rest reading is the median of this many samples before contact (1 s at 20 Hz).
_REST_SAMPLES = 20
#: Excess at the 90th percentile of the training contacts after scaling: a Velostat sheet reaches 10
#: and more under a firm grip, this sensor 0.1.
_USUAL_EXCESS = 10.0
_CHANNELS = tuple(f"v{number:02d}" for number in range(1, 17))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contact:
    """One contact, from its first sample of 0.5 N to its last.

    Attributes
    ----------
    recording : str
        Name in the file.
    time_s, force_n, lstm_n : ndarray, shape (n,)
        Time, sum of the load cells, and the authors' live estimate.
    change : ndarray, shape (n, 16)
        Relative change of each channel's conductance from the rest before the contact.
    """

    recording: str
    time_s: FloatArray
    force_n: FloatArray
    lstm_n: FloatArray
    change: FloatArray

    @property
    def is_in_contact(self) -> NDArray[np.bool_]:
        """Mask of the samples in contact."""
        return self.force_n >= SMALLEST_N


def report(
    *, recordings: Annotated[Path, typer.Option(help="Recordings of the loop.", metavar="CSV")]
) -> StudyReport:
    """Track the force of a hydrogel sensor with laws learned on the other recordings.

    Example: palpate study hydrogel --recordings hydrogel_force_control.csv.gz
    """
    contacts = read_contacts(recordings)
    splits = leave_out(contacts, lambda one: one.recording)
    if len(splits) < 2:
        raise InputError(
            f"{recordings}: only one recording; each is held out in turn, so at least two are "
            "needed"
        )
    rows = [row for _, train, tested in splits for row in score(train, tested=tested)]
    return StudyReport(
        name="hydrogel",
        title="Force of a hydrogel sensor under a robot's force loop (real)",
        provenance=(
            f"Real recordings with load cells, {len(contacts)} contacts of {SMALLEST_N:g} N and "
            "more. Each recording in turn is held out. The authors trained their LSTM, which ran "
            "live.",
            "`palpate` is `palpate.ForceLaw` on the sum of 16 channels, scaled with the training "
            "contacts. The trees have each channel and the same states as inputs.",
        ),
        tables=[Table.of("Held-out recording", rows)],
        payload={"origin": "real", "rows": rows},
    )


command = as_command(report)


def read_contacts(path: Path) -> list[Contact]:
    """Read the recordings and cut them into contacts.

    Raises `InputError` if the file can't be used or no contact follows a rest.
    """
    found = []
    numbers = ("time_s", "press", "force_n", "lstm_n", *_CHANNELS)
    for run in read_runs(path, keys=("recording", "press"), text=("recording",), numbers=numbers):
        force_n = run["force_n"]
        inside = np.flatnonzero(force_n >= SMALLEST_N)
        if len(inside) < LEAST_SAMPLES or inside[0] < _REST_SAMPLES:
            continue
        first, used = inside[0], slice(inside[0] - _REST_SAMPLES, inside[-1] + 1)
        here = np.column_stack([run[name] for name in _CHANNELS])
        rest = np.median(here[first - _REST_SAMPLES : first], axis=0)
        found.append(
            Contact(
                recording=str(run["recording"][0]),
                time_s=run["time_s"][used],
                force_n=force_n[used],
                lstm_n=run["lstm_n"][used],
                change=rest / here[used] - 1.0,
            )
        )
    if not found:
        raise InputError(f"{path}: no contact of {SMALLEST_N:g} N with a second of rest before it")
    return found


def score(train: Sequence[Contact], *, tested: Sequence[Contact]) -> list[dict[str, Any]]:
    """Return a row per method: error and coverage on the contacts of one recording."""
    summed = np.concatenate([one.change[one.is_in_contact].sum(axis=1) for one in train])
    gain = float(_USUAL_EXCESS / np.percentile(summed, 90))
    truth = np.concatenate([one.force_n[one.is_in_contact] for one in tested])
    answers = {
        "ours": _predict_by_law(train, tested, gain=gain),
        "authors' LSTM": (np.concatenate([one.lstm_n[one.is_in_contact] for one in tested]), None),
        "trees": (_predict_by_trees(train, tested, gain=gain), None),
        "mean force": (np.full(len(truth), np.mean(_forces(train))), None),
    }
    return [
        {
            "recording": tested[0].recording,
            "method": name,
            "contacts": len(tested),
            "samples": len(truth),
            "rms_n": float(np.sqrt(np.mean((value - truth) ** 2))),
            "median_abs_log_error": float(
                np.median(np.abs(np.log(np.maximum(value, SMALLEST_N) / truth)))
            ),
            "coverage": None if covers is None else float(np.mean(covers)),
        }
        for name, (value, covers) in answers.items()
    ]


def _forces(contacts: Sequence[Contact]) -> FloatArray:
    return np.concatenate([one.force_n[one.is_in_contact] for one in contacts])


def _states(one: Contact, *, gain: float) -> FloatArray:
    reading = log_reading(gain * one.change.sum(axis=1))
    return compute_states(one.time_s, reading)[one.is_in_contact]


def _predict_by_law(
    train: Sequence[Contact], tested: Sequence[Contact], *, gain: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the force of `palpate.ForceLaw`, and whether its interval covers the truth."""
    population = learn_population(
        [
            KnownContact(
                inputs=_states(one, gain=gain)[:, :INPUTS],
                force_n=one.force_n[one.is_in_contact],
                place=(one.recording, number),
            )
            for number, one in enumerate(train)
        ]
    )
    law = ForceLaw(population)
    log_n, sd = law.log_force(np.concatenate([_states(one, gain=gain) for one in tested]))
    error = np.abs(log_n - np.log(_forces(tested)))
    return np.exp(log_n), error <= half_width_sds(LEVEL) * sd


def _predict_by_trees(
    train: Sequence[Contact], tested: Sequence[Contact], *, gain: float
) -> FloatArray:
    """Return the force of boosted trees with every channel and the states as inputs."""

    def list_inputs(contacts: Sequence[Contact]) -> FloatArray:
        each = [
            np.hstack([one.change[one.is_in_contact], _states(one, gain=gain)]) for one in contacts
        ]
        return np.concatenate(each)

    machine = make_trees().fit(list_inputs(train), _forces(train))
    return np.asarray(machine.predict(list_inputs(tested)))
