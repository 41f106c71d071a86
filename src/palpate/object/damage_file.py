"""Damage file: a learned damage model and its sources, as readable JSON.

The file is written atomically. Names state units; logarithms are natural, of newtons and N/mm.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from palpate.errors import CalibrationError, InputError
from palpate.files import atomic_path, load_dataclass, load_json
from palpate.object.damage import DamageModel, DamageScore
from palpate.object.strength import FEWEST_CLOSINGS, Strength

FORMAT, VERSION = "palpate-damage-model", 2
#: Rate of all files of version 1.
_RATE_1 = 0.001
_BROKEN = (
    "incomplete or invalid JSON ({}); restore a backup or run `palpate calibrate damage` again"
)
#: Decimal places: more than closings justify, but readable.
_DIGITS = 5
#: Natural logarithm of 22 kN or 22 kN/mm; no fruit is stronger.
_LARGEST_LOG = 10.0
_STRENGTH = tuple(f.name for f in fields(Strength))


@dataclass(frozen=True, slots=True, kw_only=True)
class DamageFile:
    """A damage model and its training set."""

    #: The model for grasps.
    model: DamageModel
    #: Number of closings in the training set, by kind.
    closings: Mapping[str, int]
    #: SHA-256 of each training file, by name.
    learned_from: Mapping[str, str]
    #: Creation date and time, ISO 8601.
    made_at: str
    #: Excluded closings, with the reason.
    left_out: Mapping[str, str] = field(default_factory=dict)
    #: Cross-validation scores, by kind; ``""`` for an unknown kind.
    held_out: Mapping[str, DamageScore] = field(default_factory=dict)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds with a model of their own."""
        return tuple(kind for kind in self.model.strengths if kind)

    def check_kind(self, name: str, *, where: str) -> str:
        """Return the kind `name` if this file has a limit for it.

        Raises `InputError` if it has none; `where` is the file's name in the message.
        """
        if name in self.kinds:
            return name
        known = ", ".join(self.kinds) or "none"
        few = self.closings.get(name)
        why = f"only {few} closings of {name!r}" if few else f"no kind {name!r}"
        raise InputError(
            f"{where} has {why}; available kinds: {known}; for other kinds omit --kind"
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
            "rate": self.model.rate,
            "any_kind": strengths.pop(""),
            "kinds": strengths,
        }
        return json.dumps(document, indent=1, allow_nan=False) + "\n"

    def save(self, path: str | Path) -> None:
        """Write the file atomically."""
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
        """Read a file written by `save`.

        Raises `CalibrationError`, with a one-line message, if the file can't be read, is truncated,
        has another version, or has missing or unknown values.

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
        """Parse the output of `as_text`; `where`: the source, for messages.

        Raises `CalibrationError` as `load` does.
        """
        try:
            return _read(load_json(text))
        except (CalibrationError, InputError) as error:
            raise CalibrationError(f"{where}: {error}") from error
        except (ValueError, RecursionError) as error:
            raise CalibrationError(f"{where}: {_BROKEN.format(error)}") from error


def read_recorded_model(text: str | None) -> DamageModel | None:
    """Return the damage model stored in a recording; None without one.

    Raises `CalibrationError` as `DamageFile.load` does.
    """
    if text is None:
        return None
    return DamageFile.from_text(text, where="the damage file in the recording").model


@dataclass(frozen=True, slots=True, kw_only=True)
class _StoredKind(Strength):
    """The entry of one kind in the file."""

    low_share: float
    held_out: DamageScore | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Document:
    """Content of the file, without its format and version."""

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
    read = load_dataclass(
        _Document, {k: v for k, v in document.items() if k not in ("format", "version")}
    )
    if not 0 < read.rate < 1:
        raise CalibrationError(f"rate is {read.rate:g}; it must be between 0 and 1")
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
    for name in ("log_stiffness", "log_force", "slope", "stiffness_log_sd", "log_sd"):
        if not abs(getattr(kind, name)) <= _LARGEST_LOG:
            raise CalibrationError(
                f"{where}.{name} is {getattr(kind, name):g}; it must be from {-_LARGEST_LOG:g} to "
                f"{_LARGEST_LOG:g}"
            )
    for name in ("stiffness_log_sd", "log_sd", "low_share"):
        if not getattr(kind, name) > 0:
            raise CalibrationError(f"{where}.{name} is {getattr(kind, name):g}; it must be above 0")
    if kind.objects < FEWEST_CLOSINGS:
        raise CalibrationError(
            f"{where} has {kind.objects} closings; at least {FEWEST_CLOSINGS} are needed"
        )


def _round_all(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: round(value, _DIGITS) for name, value in numbers.items()}
