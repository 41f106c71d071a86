"""The damage file: a learned damage limit with where it comes from, as people read and keep it.

JSON, written whole or not at all. Every number has a name with its unit; the logarithms are natural
ones of newtons and N/mm.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import CalibrationError, InputError
from palpate.estimate.damage import DamageModel
from palpate.estimate.damage_learning import HeldOut
from palpate.estimate.strength import FEWEST, Strength
from palpate.files import atomic_path

FORMAT, VERSION = "palpate-damage-model", 1
_BROKEN = "not whole JSON ({}); take it from a backup or run `palpate calibrate damage` again"
#: More digits than any closing tells; people read the file.
_DIGITS = 5
_STRENGTH = tuple(f.name for f in fields(Strength))
_NUMBERS = re.compile(r"\[\s+([^][{}\"]*?)\s+\]")


@dataclass(frozen=True, slots=True, kw_only=True)
class DamageFile:
    """A damage model and what it was learned from."""

    #: What a grasp uses.
    model: DamageModel
    #: How many were learned from, by kind.
    closings: Mapping[str, int]
    #: SHA-256 of each file that they came from, by name.
    learned_from: Mapping[str, str]
    #: ISO 8601 date and time.
    made_at: str
    #: Closings that were not learned from, and why.
    left_out: Mapping[str, str] = field(default_factory=dict)
    #: What was said of closings left out in turn, by kind; ``""`` where the kind is not told.
    held_out: Mapping[str, HeldOut] = field(default_factory=dict)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return the kinds that are told apart."""
        return tuple(kind for kind in self.model.strengths if kind)

    def known_kind(self, name: str, *, where: str) -> str:
        """Return the name of a kind that a grasp may be told.

        Raises
        ------
        InputError
            If this file has no limit of its own for that kind.
        """
        if name in self.kinds:
            return name
        known = ", ".join(self.kinds) or "none"
        few = self.closings.get(name)
        why = f"only {few} closings of {name!r}" if few else f"no kind {name!r}"
        raise InputError(
            f"{where} has {why}; it tells apart: {known}; leave --kind out for anything else"
        )

    def as_text(self) -> str:
        """Return the content of the file."""
        strengths = {kind: self._kind_as_dict(kind) for kind in self.model.strengths}
        document = {
            "format": FORMAT,
            "version": VERSION,
            "made_at": self.made_at,
            "learned_from": dict(self.learned_from),
            "closings": dict(self.closings),
            "left_out": dict(self.left_out),
            "any_kind": strengths.pop(""),
            "kinds": strengths,
            "critical_scores": [
                round(float(score), _DIGITS) for score in self.model.critical_scores
            ],
        }
        text = json.dumps(document, indent=1, allow_nan=False)
        return _NUMBERS.sub(lambda m: f"[{' '.join(m[1].split())}]", text) + "\n"

    def save(self, path: str | Path) -> None:
        """Write the file, whole or not at all."""
        text = self.as_text()
        with atomic_path(path) as partial:
            partial.write_text(text)

    def _kind_as_dict(self, kind: str) -> dict[str, Any]:
        checked = self.held_out.get(kind)
        return {
            **_rounded(asdict(self.model.strengths[kind])),
            "low_share": round(self.model.low_shares[kind], _DIGITS),
            "held_out": None if checked is None else _rounded(asdict(checked)),
        }

    @classmethod
    def load(cls, path: str | Path) -> DamageFile:
        """Read what `save` wrote.

        Raises
        ------
        CalibrationError
            If it can't be read, is cut, comes from a newer version, or lacks or misnames a value;
            one line that says which.

        Examples
        --------
        >>> DamageFile.load("no-such-file.json")
        Traceback (most recent call last):
        palpate.errors.CalibrationError: damage file no-such-file.json: No such file or directory
        """
        try:
            text = Path(path).read_text(encoding="utf-8-sig")
        except OSError as error:
            raise CalibrationError(f"damage file {path}: {error.strerror}") from error
        except UnicodeDecodeError as error:
            raise CalibrationError(f"damage file {path}: {_BROKEN.format(error)}") from error
        return cls.from_text(text, where=f"damage file {path}")

    @classmethod
    def from_text(cls, text: str, *, where: str) -> DamageFile:
        """Read what `as_text` wrote; `where` it comes from is for errors.

        Raises
        ------
        CalibrationError
            As `load`.
        """
        try:
            return _read(json.loads(text))
        except CalibrationError as error:
            raise CalibrationError(f"{where}: {error}") from error
        except (ValueError, ArithmeticError, RecursionError) as error:
            raise CalibrationError(f"{where}: {_BROKEN.format(error)}") from error


def recorded_model(text: str | None) -> DamageModel | None:
    """Return the model of a damage file kept in a recording, None where none was.

    Raises
    ------
    CalibrationError
        As `DamageFile.load`.
    """
    if text is None:
        return None
    return DamageFile.from_text(text, where="the damage file in the recording").model


_KEYS = (
    "made_at",
    "learned_from",
    "closings",
    "left_out",
    "any_kind",
    "kinds",
    "critical_scores",
)


def _read(document: Any) -> DamageFile:
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise CalibrationError(f"its format is not {FORMAT!r}; is it a damage file?")
    if document.get("version") != VERSION:
        raise CalibrationError(
            f"written by another version of palpate (file version {document.get('version')}, this "
            f"one reads {VERSION}); update palpate or run `palpate calibrate damage` again"
        )
    stated = _table(document, ("format", "version", *_KEYS), where="the file")
    tables = {"": stated["any_kind"], **_any_table(stated["kinds"], where="kinds")}
    strengths, low_shares, held_out = {}, {}, {}
    for kind, stored in tables.items():
        where = f"kinds.{kind}" if kind else "any_kind"
        table = dict(_table(stored, (*_STRENGTH, "low_share", "held_out"), where=where))
        checked = table.pop("held_out")
        low_shares[kind] = _positive(table.pop("low_share"), where=f"{where}.low_share")
        strengths[kind] = _strength(table, where=where)
        if checked is not None:
            held_out[kind] = _held_out(checked, where=f"{where}.held_out")
    return DamageFile(
        model=DamageModel(
            critical_scores=_scores(stated["critical_scores"]),
            strengths=strengths,
            low_shares=low_shares,
        ),
        closings={
            kind: _whole(count, where=f"closings.{kind}")
            for kind, count in _any_table(stated["closings"], where="closings").items()
        },
        learned_from=_texts(stated["learned_from"], where="learned_from"),
        made_at=_texts({"made_at": stated["made_at"]}, where="the file")["made_at"],
        left_out=_texts(stated["left_out"], where="left_out"),
        held_out=held_out,
    )


def _strength(table: Mapping[str, Any], *, where: str) -> Strength:
    numbers = {name: _number(value, where=f"{where}.{name}") for name, value in table.items()}
    for name in ("stiffness_log_sd", "log_sd"):
        _positive(numbers[name], where=f"{where}.{name}")
    objects = _whole(table["objects"], where=f"{where}.objects")
    if objects < FEWEST:
        raise CalibrationError(f"{where} rests on {objects} closings; {FEWEST} are needed")
    return Strength(
        log_stiffness=numbers["log_stiffness"],
        stiffness_log_sd=numbers["stiffness_log_sd"],
        log_force=numbers["log_force"],
        slope=numbers["slope"],
        log_sd=numbers["log_sd"],
        objects=objects,
    )


def _held_out(stored: Any, *, where: str) -> HeldOut:
    table = _table(stored, [f.name for f in fields(HeldOut)], where=where)
    numbers = {name: _number(value, where=f"{where}.{name}") for name, value in table.items()}
    return HeldOut(
        closings=_whole(table["closings"], where=f"{where}.closings"),
        error_percent=numbers["error_percent"],
        median_error_percent=numbers["median_error_percent"],
        above_low=numbers["above_low"],
    )


def _rounded(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: round(value, _DIGITS) for name, value in numbers.items()}


def _scores(stored: Any) -> NDArray[np.float64]:
    if not isinstance(stored, list):
        raise CalibrationError("critical_scores must be a list of numbers")
    scores = np.array([_number(score, where="critical_scores") for score in stored])
    if len(scores) < FEWEST or np.any(np.diff(scores) < 0):
        raise CalibrationError(f"critical_scores must be {FEWEST} numbers or more, rising")
    return scores


def _table(stored: Any, names: Sequence[str], *, where: str) -> Mapping[str, Any]:
    """Return a table that has just these names."""
    table = _any_table(stored, where=where)
    missing, unknown = sorted(set(names) - set(table)), sorted(set(table) - set(names))
    if missing or unknown:
        lacks = [f"lacks {', '.join(missing)}"] if missing else []
        has = [f"has {', '.join(unknown)}, which is not known"] if unknown else []
        raise CalibrationError(f"{where} {' and '.join(lacks + has)}")
    return table


def _any_table(stored: Any, *, where: str) -> Mapping[str, Any]:
    if not isinstance(stored, dict):
        raise CalibrationError(f"{where} is {stored!r:.40}, not a table")
    return stored


def _texts(stored: Any, *, where: str) -> Mapping[str, str]:
    for name, text in _any_table(stored, where=where).items():
        if not isinstance(text, str):
            raise CalibrationError(f"{where}: {name} is {text!r:.40}, not text")
    return dict(stored)


def _number(value: Any, *, where: str) -> float:
    if type(value) not in (int, float) or not math.isfinite(value):
        raise CalibrationError(f"{where} is {value!r:.40}, not a finite number")
    return float(value)


def _positive(value: Any, *, where: str) -> float:
    number = _number(value, where=where)
    if not number > 0:
        raise CalibrationError(f"{where} is {number:g}; it must be above 0")
    return number


def _whole(value: Any, *, where: str) -> int:
    if type(value) is not int or value < 0:
        raise CalibrationError(f"{where} is {value!r:.40}, not a count")
    return value
