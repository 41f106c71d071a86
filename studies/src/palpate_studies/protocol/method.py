"""A method: one name, one `fit`. The same interface for every challenge.

A challenge asks questions that have one positive number as their answer: the value that a hold
settles to, the load on a sensor, the force at which a fruit ruptures. Errors are compared as
absolute logarithms of the ratio, so that units and scales drop out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate_studies.protocol.parts import Fold, Learned


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """The part of a case that a method may see.

    Attributes
    ----------
    curve : ndarray, shape (points, 2)
        What was read so far: abscissa and reading, in time's order. The challenge defines both.
    asked : float
        The abscissa at which the answer is wanted.
    scale : float
        A positive number of the answer's size, known from the curve: the last reading, for example.
    kind : str
        A label that is known beforehand, such as the kind of fruit.
    """

    curve: FloatArray
    asked: float
    scale: float
    kind: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A question with its true answer, to learn from or to be scored on.

    Attributes
    ----------
    question : Question
        What a method may see.
    truth : float
        The answer.
    specimen : str
        What is left out together.
    name : str
        Of the case, for messages.
    whole : ndarray, shape (points, 2)
        The curve beyond the question, as far as it was recorded: to learn from.
    """

    question: Question
    truth: float
    specimen: str
    name: str
    whole: FloatArray


Answer: TypeAlias = Callable[[Question], float]


class Method(Protocol):
    """Anything with a name and a `fit`.

    `fit` is given cases to learn from and others to choose settings on, and returns a function of
    a question. A method that chooses nothing may learn from both.
    """

    @property
    def name(self) -> str:
        """Its name in tables."""

    def fit(self, training: Sequence[Case], *, choosing: Sequence[Case]) -> Answer:
        """Learn, and return what answers a question with a positive number."""


def losses(method: Method, cases: Sequence[Case], *, parts: Iterable[Fold]) -> FloatArray:
    """Fit a fresh copy of a method in every fold; return the loss on each case, shape (cases,).

    A copy, because what a method remembers of one fold are answers of the next.

    Raises
    ------
    InputError
        If an answer is not a positive number.
    """
    found = np.full(len(cases), np.nan)
    for fold in parts:
        training, choosing = _of(cases, fold.train), _of(cases, fold.choose)
        learned = Learned(
            found=deepcopy(method).fit(training, choosing=choosing),
            seen=frozenset(case.specimen for case in (*training, *choosing)),
        )
        tested = [index for index, case in enumerate(cases) if case.specimen in fold.test]
        answer = learned.on(cases[index].specimen for index in tested)
        for index in tested:
            found[index] = _loss(method.name, answer, cases[index])
    return found


def log_error(said: float, truth: float) -> float:
    """Return the absolute logarithm of the ratio.

    Examples
    --------
    >>> round(log_error(11.0, 10.0), 3), round(log_error(10.0, 11.0), 3)
    (0.095, 0.095)
    """
    return float(abs(np.log(said / truth)))


def _loss(name: str, answer: Answer, case: Case) -> float:
    answered = float(answer(case.question))
    if not (np.isfinite(answered) and answered > 0):
        raise InputError(f"{name}: answered {answered:g} to {case.name}; answer a positive number")
    return log_error(answered, case.truth)


def _of(cases: Sequence[Case], specimens: Sequence[str]) -> list[Case]:
    return [case for case in cases if case.specimen in specimens]
