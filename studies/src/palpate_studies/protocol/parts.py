"""Training, choosing and test parts, kept apart in code.

Whatever was fitted or chosen carries the names of the specimens that it has seen. It can be used
only through `on`, which refuses specimens among them. So a score of what a setting was chosen on is
no matter of discipline: it cannot be computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from palpate.errors import InputError

Found = TypeVar("Found")
Setting = TypeVar("Setting")


class SeenBeforeError(InputError):
    """A score was asked for on specimens that the method or its setting has seen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Learned(Generic[Found]):
    """A part that was fitted or chosen, with the specimens that it rests on.

    Attributes
    ----------
    found : object
        A setting, a function, a model. Use `on` to get at it for a test.
    seen : frozenset of str
        Specimens that it was fitted to or chosen on.

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
        """Return what was learned, to be used on these specimens.

        Raises
        ------
        SeenBeforeError
            If it has seen any of them.
        """
        overlap = sorted(self.seen & set(specimens))
        if overlap:
            named = ", ".join(overlap[:3]) + (" and others" if len(overlap) > 3 else "")
            was = "was" if len(overlap) == 1 else "were"
            raise SeenBeforeError(
                f"{named} {was} used for fitting or choosing; score on other specimens"
            )
        return self.found


def choose(
    settings: Sequence[Setting],
    *,
    loss: Callable[[Setting], float | tuple[float, ...]],
    on: Iterable[str],
) -> Learned[Setting]:
    """Return the setting of the smallest loss, with the specimens it was chosen on.

    Parameters
    ----------
    settings : sequence
        What is tried; of equally good ones the first is taken.
    loss : callable
        Setting -> loss on the choosing part; of a tuple the first number counts first.
    on : iterable of str
        Specimens of that part.

    Examples
    --------
    >>> choose([1.0, 2.0, 3.0], loss=lambda x: (x - 2.1) ** 2, on=["a", "b"]).on(["c"])
    2.0
    """
    return Learned(found=min(settings, key=loss), seen=frozenset(on))


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold:
    """Three groups of specimens that share none.

    Attributes
    ----------
    train, choose, test : tuple of str
        Specimens to fit to, to choose settings on, and to score.
    """

    train: tuple[str, ...]
    choose: tuple[str, ...]
    test: tuple[str, ...]

    def __post_init__(self) -> None:
        groups = (self.train, self.choose, self.test)
        if len(set().union(*groups)) != sum(len(set(group)) for group in groups):
            raise SeenBeforeError("a specimen is in two parts of a fold; split by specimen")


def folds(specimens: Iterable[str], *, count: int) -> list[Fold]:
    """Split specimens into folds: each is tested once, the group after it chooses, others train.

    Parameters
    ----------
    specimens : iterable of str
        In any order and repeated as they come; the order of first appearance decides.
    count : int
        Groups, at least three; as many as there are specimens leaves each out once.

    Raises
    ------
    ValueError
        If there are fewer specimens than groups, or fewer than three groups.

    Examples
    --------
    >>> folds(["a", "b", "c"], count=3)[0]
    Fold(train=('c',), choose=('b',), test=('a',))
    """
    names = list(dict.fromkeys(specimens))
    if not 3 <= count <= len(names):
        raise ValueError(f"{count} folds of {len(names)} specimens; from 3 to one per specimen")
    groups = [tuple(names[start::count]) for start in range(count)]
    found = []
    for index, test in enumerate(groups):
        after = (index + 1) % count
        rest = [g for place, g in enumerate(groups) if place not in (index, after)]
        found.append(Fold(train=sum(rest, ()), choose=groups[after], test=test))
    return found
