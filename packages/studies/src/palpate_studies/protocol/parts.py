"""Separation of training and test sets, enforced in code.

A fitted model or chosen setting carries the names of its training specimens. It can be used only
through `on`, which refuses these specimens. A model can therefore not be scored on its training
set.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

from palpate.errors import InputError

Found = TypeVar("Found")


class SeenBeforeError(InputError):
    """A model or setting was used on specimens of its training set."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Learned(Generic[Found]):
    """A fitted model or chosen setting, with its training specimens.

    Attributes
    ----------
    found : object
        Setting, function or model. Tests access it through `on`.
    seen : frozenset of str
        Specimens used for fitting or choosing.

    Examples
    --------
    >>> gain = Learned(found=1.2, seen=frozenset({"sensor-1", "sensor-2"}))
    >>> gain.on(["sensor-3"])
    1.2
    >>> gain.on(["sensor-1", "sensor-3"])
    Traceback (most recent call last):
    palpate_studies.protocol.parts.SeenBeforeError: sensor-1 was used for fitting or choosing; \
score on other specimens
    """

    found: Found
    seen: frozenset[str]

    def on(self, specimens: Iterable[str]) -> Found:
        """Return the model or setting for use on these specimens.

        Raises
        ------
        SeenBeforeError
            If any of them is a training specimen.
        """
        overlap = sorted(self.seen & set(specimens))
        if overlap:
            named = ", ".join(overlap[:3]) + (" and others" if len(overlap) > 3 else "")
            was = "was" if len(overlap) == 1 else "were"
            raise SeenBeforeError(
                f"{named} {was} used for fitting or choosing; score on other specimens"
            )
        return self.found
