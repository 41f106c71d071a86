"""`palpate sort --identify ITEM`: the kind of an item of the store, by its grasps."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import typer

from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.produce.identify.identifier import Identifier, Identity


def identify(item: str, *, store: str | None, as_json: bool) -> None:
    """Identify an item by size and stiffness and keep the answer with it; exit with 1 if unknown.

    Raises `InputError` if no grasp of it measured both, or too few items are labelled.
    """
    from palpate.commands.items import opened
    from palpate.produce.identify.items import drive_of, identity_verdict, learn_kinds, touches_of

    with opened(store) as kept:
        kept.item(item)
        grasps = kept.grasps_of(item)
        drive = drive_of(grasps, item_id=item)
        touches = touches_of(grasps, drive=drive)
        if not touches:
            raise InputError(
                f"item {item!r}: no grasp of it measured size and stiffness; grasp it again with "
                "fingers driven by width"
            )
        known = learn_kinds(kept, drive=drive, without=item)
        identity = known.identify(touches)
        verdict = identity_verdict(item, identity, given_at=datetime.now(UTC))
        kept.add_verdict(verdict)
    simulated = any(grasp.simulated for grasp in grasps)
    if as_json:
        document = {
            "item_id": item,
            "kind": identity.kind,
            "confidence": identity.confidence,
            "rejected": identity.rejected,
            "usual": identity.usual,
            "probability": dict(identity.probability),
            "grasps": identity.grasps,
            "explanation": verdict.explanation,
            "simulated": simulated,
        }
        print(json.dumps(document, allow_nan=False, indent=1))
    else:
        _show(item, identity, known, why=verdict.explanation, simulated=simulated)
    if identity.rejected:
        raise typer.Exit(1)


def _show(item: str, identity: Identity, known: Identifier, *, why: str, simulated: bool) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from palpate.produce.identify.identifier import UNKNOWN

    console = Console()
    note = " (simulated)" if simulated else ""
    console.print(f"[bold]{escape(f'{item}: {identity.kind}')}[/bold]{note}", highlight=False)
    table = Table("kind", box=None, header_style="dim")
    table.add_column("probability, %", justify="right")
    for kind, probability in sorted(identity.probability.items(), key=lambda pair: -pair[1]):
        table.add_row(
            "something else" if kind == UNKNOWN else escape(kind), f"{100 * probability:.1f}"
        )
    console.print(table)
    console.print(why, highlight=False)
    if known.items_missing:
        console.print(
            f"To call anything unknown at {100 * known.false_reject:g} %, label "
            f"{known.items_missing} more items.",
            highlight=False,
        )
