"""Force of a hydrogel sensor in a robot's force loop, each recording left out in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from scipy.special import ndtri

from palpate import ForceLaw
from palpate.arrays import FloatArray
from palpate.errors import InputError, needing
from palpate.estimate.force_law import INPUTS
from palpate.estimate.force_states import log_reading, states_of
from palpate.holds.strict import read_table
from palpate_studies.force_learning import KnownContact, learn_population
from palpate_studies.report import StudyReport, Table, as_command

LEVEL = 0.9
#: Forces from here on are scored, newtons; a contact has at least so many scored samples.
SMALLEST_N, LEAST_SAMPLES = 0.5, 20
#: The rest reading is the median of this many samples before contact (1 s at 20 Hz).
_REST_SAMPLES = 20
#: Excess that the training contacts reach at their 90th percentile after scaling: a sheet of
#: Velostat shows 10 and more under a firm grip, this sensor .1.
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
        Clock, sum of the load cells, and the authors' live estimate.
    change : ndarray, shape (n, 16)
        Relative change of conductance of each channel since the rest before the contact.
    """

    recording: str
    time_s: FloatArray
    force_n: FloatArray
    lstm_n: FloatArray
    change: FloatArray

    @property
    def scored(self) -> NDArray[np.bool_]:
        """Samples in contact."""
        return self.force_n >= SMALLEST_N


def report(
    *, recordings: Annotated[Path, typer.Option(help="Recordings of the loop.", metavar="CSV")]
) -> StudyReport:
    """Follow the force of a hydrogel sensor by laws learned on the other recordings.

    Example: palpate study hydrogel --recordings hydrogel_force_control.csv.gz
    """
    contacts = read_contacts(recordings)
    names = list(dict.fromkeys(one.recording for one in contacts))
    if len(names) < 2:
        raise InputError(f"{recordings}: one recording; each is left out in turn, give two")
    rows = [
        row
        for name in names
        for row in score(
            [one for one in contacts if one.recording != name],
            tested=[one for one in contacts if one.recording == name],
        )
    ]
    return StudyReport(
        name="hydrogel",
        title="Force of a hydrogel sensor under a robot's force loop (real)",
        provenance=(
            f"Real recordings with load cells, {len(contacts)} contacts from {SMALLEST_N:g} N on. "
            "Each recording in turn is left out of what the laws learn; the authors' LSTM was "
            "trained by its authors and ran live.",
            "`ours` is `palpate.ForceLaw` on the sum of 16 channels, scaled by the training "
            "contacts; ridge and trees see each channel and the same states.",
        ),
        tables=[
            Table.of(
                "Recording left out",
                rows,
                {
                    "recording": "{recording}",
                    "contacts": "{contacts}",
                    "method": "{method}",
                    "RMS error, N": "{rms_n:.1f}",
                    "median |ln error|": "{median_abs_log_error:.2f}",
                    "coverage": "{coverage:.2f}",
                },
            )
        ],
        payload={"study": "hydrogel", "origin": "real", "rows": rows},
    )


command = as_command(report)


def read_contacts(path: Path) -> list[Contact]:
    """Read the recordings and cut them into contacts.

    Raises `InputError` if the file can't be used or no contact in it has a rest before it.
    """
    numbers = ("time_s", "press", "force_n", "lstm_n", *_CHANNELS)
    table = read_table(path, columns={"recording": "text", **dict.fromkeys(numbers, "number")})
    voltage = np.column_stack([table[name] for name in _CHANNELS])
    found = []
    keys = list(zip(table["recording"], table["press"], strict=True))
    for recording, press in dict.fromkeys(keys):
        mine = (table["recording"] == recording) & (table["press"] == press)
        force_n = table["force_n"][mine]
        inside = np.flatnonzero(force_n >= SMALLEST_N)
        if len(inside) < LEAST_SAMPLES or inside[0] < _REST_SAMPLES:
            continue
        first, used = inside[0], slice(inside[0] - _REST_SAMPLES, inside[-1] + 1)
        here = voltage[mine]
        rest = np.median(here[first - _REST_SAMPLES : first], axis=0)
        found.append(
            Contact(
                recording=str(recording),
                time_s=table["time_s"][mine][used],
                force_n=force_n[used],
                lstm_n=table["lstm_n"][mine][used],
                change=rest / here[used] - 1.0,
            )
        )
    if not found:
        raise InputError(f"{path}: no contact of {SMALLEST_N:g} N with a second of rest before it")
    return found


def score(train: Sequence[Contact], *, tested: Sequence[Contact]) -> list[dict[str, Any]]:
    """Return a row a method: error and coverage on the contacts of one recording."""
    gain = _USUAL_EXCESS / np.percentile(np.concatenate([_summed(one) for one in train]), 90)
    truth = np.concatenate([one.force_n[one.scored] for one in tested])
    learned = _learned(train, tested, gain=float(gain))
    answers = {
        "ours": _by_law(train, tested, gain=float(gain)),
        "authors' LSTM": (np.concatenate([one.lstm_n[one.scored] for one in tested]), None),
        **{name: (value, None) for name, value in learned.items()},
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


def _summed(one: Contact) -> FloatArray:
    return np.asarray(one.change[one.scored].sum(axis=1))


def _forces(contacts: Sequence[Contact]) -> FloatArray:
    return np.concatenate([one.force_n[one.scored] for one in contacts])


def _states(one: Contact, *, gain: float) -> FloatArray:
    reading = log_reading(gain * one.change.sum(axis=1))
    return states_of(one.time_s, reading)[one.scored]


def _by_law(
    train: Sequence[Contact], tested: Sequence[Contact], *, gain: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the force by `palpate.ForceLaw`, and where its interval holds the truth."""
    population = learn_population(
        [
            KnownContact(
                inputs=_states(one, gain=gain)[:, :INPUTS],
                force_n=one.force_n[one.scored],
                weight=np.ones(int(one.scored.sum())),
                place=(one.recording, number),
            )
            for number, one in enumerate(train)
        ]
    )
    law = ForceLaw(population)
    log_n, sd = law.log_force(np.concatenate([_states(one, gain=gain) for one in tested]))
    away = np.abs(log_n - np.log(_forces(tested)))
    return np.exp(log_n), away <= float(ndtri(0.5 + LEVEL / 2)) * sd


def _learned(
    train: Sequence[Contact], tested: Sequence[Contact], *, gain: float
) -> dict[str, FloatArray]:
    """Return the force by ridge and by boosted trees, which see every channel and the states."""
    with needing("ridge and gradient boosting", extra="produce"):
        from sklearn.ensemble import HistGradientBoostingRegressor
        from sklearn.linear_model import Ridge
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

    def seen(contacts: Sequence[Contact]) -> FloatArray:
        each = [np.hstack([one.change[one.scored], _states(one, gain=gain)]) for one in contacts]
        return np.concatenate(each)

    machines = {
        "ridge": make_pipeline(StandardScaler(), Ridge(alpha=1.0)),
        "trees": HistGradientBoostingRegressor(random_state=0),
    }
    inputs, force_n, unseen = seen(train), _forces(train), seen(tested)
    return {
        name: np.asarray(machine.fit(inputs, force_n).predict(unseen))
        for name, machine in machines.items()
    }
