"""The damage file: a learned damage limit and its sources, as readable text.

JSON, written whole or not at all. Every number has a name with its unit; the logarithms are natural
ones of newtons and N/mm.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from palpate.errors import CalibrationError, InputError
from palpate.estimate.damage import DamageModel
from palpate.estimate.damage_learning import HeldOut
from palpate.estimate.strength import FEWEST_CLOSINGS, Strength
from palpate.files import atomic_path, structure

FORMAT, VERSION = "palpate-damage-model", 2
#: Rate of every file of version 1.
_RATE_1 = 0.001
_BROKEN = "not whole JSON ({}); take it from a backup or run `palpate calibrate damage` again"
#: More digits than any closing supports; people read the file.
_DIGITS = 5
_STRENGTH = tuple(f.name for f in fields(Strength))


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
    #: Predictions for closings left out in turn, by kind; ``""`` where the kind is not given.
    held_out: Mapping[str, HeldOut] = field(default_factory=dict)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return the kinds that are distinguished."""
        return tuple(kind for kind in self.model.strengths if kind)

    def check_kind(self, name: str, *, where: str) -> str:
        """Return the name of a kind that may be given for a grasp.

        Raises `InputError` if this file has no limit of its own for that kind.
        """
        if name in self.kinds:
            return name
        known = ", ".join(self.kinds) or "none"
        few = self.closings.get(name)
        why = f"only {few} closings of {name!r}" if few else f"no kind {name!r}"
        raise InputError(f"{where} has {why}; its kinds are {known}; omit --kind for any other")

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
            "rate": self.model.rate,
            "any_kind": strengths.pop(""),
            "kinds": strengths,
        }
        return json.dumps(document, indent=1, allow_nan=False) + "\n"

    def save(self, path: str | Path) -> None:
        """Write the file, whole or not at all."""
        text = self.as_text()
        with atomic_path(path) as partial:
            partial.write_text(text)

    def _kind_as_dict(self, kind: str) -> dict[str, Any]:
        checked = self.held_out.get(kind)
        return {
            **_round_all(asdict(self.model.strengths[kind])),
            "low_share": round(self.model.low_fractions[kind], _DIGITS),
            "held_out": None if checked is None else _round_all(asdict(checked)),
        }

    @classmethod
    def load(cls, path: str | Path) -> DamageFile:
        """Read what `save` wrote.

        Raises `CalibrationError` if it can't be read, is cut, comes from a newer version, or lacks
        or misnames a value; one line that names it.

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

        Raises `CalibrationError` as `load` does.
        """
        try:
            return _read(json.loads(text))
        except (CalibrationError, InputError) as error:
            raise CalibrationError(f"{where}: {error}") from error
        except (ValueError, RecursionError) as error:
            raise CalibrationError(f"{where}: {_BROKEN.format(error)}") from error


def read_recorded_model(text: str | None) -> DamageModel | None:
    """Return the model of a damage file kept in a recording, None where none was.

    Raises `CalibrationError` as `DamageFile.load` does.
    """
    if text is None:
        return None
    return DamageFile.from_text(text, where="the damage file in the recording").model


@dataclass(frozen=True, slots=True, kw_only=True)
class _StoredKind(Strength):
    """The entry of one kind in the file."""

    low_share: float
    held_out: HeldOut | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Document:
    """The file, without its format and version."""

    made_at: str
    learned_from: Mapping[str, str]
    closings: Mapping[str, int]
    left_out: Mapping[str, str]
    any_kind: _StoredKind
    kinds: Mapping[str, _StoredKind]
    rate: float


def _read(document: Any) -> DamageFile:
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise CalibrationError(f"its format is not {FORMAT!r}; is it a damage file?")
    if document.get("version") == 1:
        document = {**document, "version": VERSION, "rate": _RATE_1}
        document.pop("critical_scores", None)
    if document.get("version") != VERSION:
        raise CalibrationError(
            f"written by another version of palpate (file version {document.get('version')}, this "
            f"one reads {VERSION}); update palpate or run `palpate calibrate damage` again"
        )
    read = structure(
        _Document, {k: v for k, v in document.items() if k not in ("format", "version")}
    )
    if not 0 < read.rate < 1:
        raise CalibrationError(f"rate is {read.rate:g}; it must lie between 0 and 1")
    kinds = {"": read.any_kind, **read.kinds}
    for kind, stored in kinds.items():
        _check(stored, where=f"kinds.{kind}" if kind else "any_kind")
    return DamageFile(
        model=DamageModel(
            rate=read.rate,
            strengths={
                kind: Strength(**{name: getattr(stored, name) for name in _STRENGTH})
                for kind, stored in kinds.items()
            },
            low_fractions={kind: stored.low_share for kind, stored in kinds.items()},
        ),
        closings=read.closings,
        learned_from=read.learned_from,
        made_at=read.made_at,
        left_out=read.left_out,
        held_out={kind: one.held_out for kind, one in kinds.items() if one.held_out is not None},
    )


def _check(kind: _StoredKind, *, where: str) -> None:
    for name in ("stiffness_log_sd", "log_sd", "low_share"):
        if not getattr(kind, name) > 0:
            raise CalibrationError(f"{where}.{name} is {getattr(kind, name):g}; it must be above 0")
    if kind.objects < FEWEST_CLOSINGS:
        raise CalibrationError(
            f"{where} rests on {kind.objects} closings; {FEWEST_CLOSINGS} are needed"
        )


def _round_all(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: round(value, _DIGITS) for name, value in numbers.items()}
