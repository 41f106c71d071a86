"""Kinds learned from the store, and stored identities of items."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import TYPE_CHECKING

from palpate.arrays import FloatArray
from palpate.grasp.result import Outcome
from palpate_station.identify.identifier import Identifier, Identity, grasp_features
from palpate_station.learning import FEWEST_ITEMS
from palpate_station.records import About, Grasp, Source, Verdict

if TYPE_CHECKING:
    from palpate_station.store import Store


#: Maximum number of items read (newest first), and of training items per kind. The limits keep
#: old labels from dominating the training set.
_MOST_ITEMS, _MOST_OF_A_KIND = 5000, 200
#: Why a store can't identify any kind.
NO_KINDS = f"no kind has {FEWEST_ITEMS} labelled items"


def learn_kinds(store: Store, *, without: str | None = None) -> Identifier:
    """Learn all kinds with enough labelled items in the store.

    `store`: items with a `kind` or an identity label by a person, and their grasps.
    `without`: item to identify; excluded from the training set.
    Raises `InputError` if no kind has enough labelled items; `MissingExtraError` if scikit-learn is
    not installed.
    """
    training: dict[str, list[tuple[str, Sequence[FloatArray]]]] = defaultdict(list)
    stated = {
        verdict.item_id: verdict.text
        for verdict in store.verdicts(About.IDENTITY, source=Source.PERSON)
    }
    for item in store.items(limit=_MOST_ITEMS):
        kind = stated.get(item.item_id, item.kind)
        if kind is None or item.item_id == without or len(training[kind]) >= _MOST_OF_A_KIND:
            continue
        if points := item_features(store.grasps_of(item.item_id)):
            training[kind].append((kind, points))
    enough = [kind for kind in training.values() if len(kind) >= FEWEST_ITEMS]
    return Identifier([one for kind in enough for one in kind])


def item_features(grasps: Iterable[Grasp]) -> tuple[FloatArray, ...]:
    """Return the features of completed grasps that measured size and stiffness."""
    found = (grasp_features(one.measurements) for one in grasps if one.outcome is Outcome.HELD)
    return tuple(features for features in found if features is not None)


def identity_verdict(item_id: str, identity: Identity, *, given_at: datetime) -> Verdict:
    """Return an identity as a verdict of the store."""
    return Verdict(
        item_id=item_id,
        about=About.IDENTITY,
        text=identity.kind,
        given_at=given_at,
        probability=identity.confidence,
        explanation=explain_identity(identity),
        details={
            "probabilities": {kind: round(p, 6) for kind, p in identity.probability.items()},
            "usual": identity.usual,
            "rejected": identity.rejected,
            "grasps": identity.grasps,
        },
    )


def explain_identity(identity: Identity) -> str:
    """Return a sentence with the item's kind and its probability.

    >>> probability = {"kiwi": 0.9, "tomato": 0.1}
    >>> one = Identity(kind="kiwi", probability=probability, usual=0.4, rejected=False, grasps=1)
    >>> print(explain_identity(one))
    kiwi 90 %, tomato 10 %; 40 % of training items are at least as atypical; 1 grasp.
    """
    count = f"{identity.grasps} grasp{'s' if identity.grasps != 1 else ''}"
    atypical = f"{100 * identity.usual:.2g} % of training items are at least as atypical"
    if identity.rejected:
        return (
            f"Unlike every labelled kind: {atypical}; most similar kind {identity.best_guess}; "
            f"{count}."
        )
    ranked = identity.rank_kinds(3, least=0.01)
    named = ", ".join(f"{kind} {100 * p:.0f} %" for kind, p in ranked)
    return f"{named}; {atypical}; {count}."
