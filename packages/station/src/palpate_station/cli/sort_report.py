"""Output of `palpate sort`: each item's bin with the reason, purity and throughput."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rich.markup import escape

from palpate.cli.output import print_json
from palpate.terminal_table import make_console, print_table
from palpate_station.sorting.rules import RuleBook
from palpate_station.sorting.run import Sorted
from palpate_station.sorting.score import CARRY_S, TURN_S, Placed, score_sorting


@dataclass(kw_only=True)
class SortReport:
    """Collects and prints sorting decisions."""

    #: Sorting rules.
    book: RuleBook
    #: Whether this is a dry run with stored grasps.
    dry: bool
    #: Called with the number of sorted items.
    show: Callable[[float], None] | None = None
    _simulated: bool = False
    _rows: list[dict[str, Any]] = field(default_factory=list)
    _placed: list[Placed] = field(default_factory=list)

    def add(self, done: Sorted, *, true_bin: str | None) -> None:
        """Add one decision.

        `true_bin`: the item's true bin in a simulation; None if unknown.
        """
        placed = Placed(
            bin=done.decision.bin,
            true_bin=true_bin,
            grasps=len(done.grasps),
            grasping_s=done.grasping_s,
        )
        self._placed.append(placed)
        self._rows.append(_row(done, placed))
        self._simulated |= any(grasp.is_simulated for grasp in done.grasps)
        if self.show is not None:
            self.show(len(self._rows))

    def emit(self, *, as_json: bool) -> None:
        """Print the decisions and the summary."""
        document = self._document()
        if as_json:
            print_json(document)
        elif document["rows"]:
            self._print(document)
        else:
            print("no items")

    def _document(self) -> dict[str, Any]:
        summary: dict[str, Any] | None = None
        if self._placed:
            found = score_sorting(self._placed, book=self.book)
            summary = {
                "items": found.items,
                "left_over": found.left_over,
                "purity": found.purity,
                "bins": {
                    name: {"items": count, "right": None if found.purity is None else right}
                    for name, (count, right) in found.bins.items()
                },
                "grasps_per_item": found.grasps_per_item,
                "items_per_hour": None if self.dry else found.items_per_hour,
            }
        return {
            "simulated": self._simulated,
            "dry_run": self.dry,
            "rows": self._rows,
            "summary": summary,
            "assumed": None if self.dry else {"carry_s": CARRY_S, "turn_s": TURN_S},
        }

    def _print(self, document: dict[str, Any]) -> None:
        console = make_console()
        rows = []
        for one in document["rows"]:
            wrong = one["belongs"] not in (None, one["bin"])
            note = f" [red](true bin: {escape(one['belongs'])})[/red]" if wrong else ""
            probability = one["probability"]
            rows.append(
                (
                    f"[bold]{escape(one['item_id'])}[/bold]",
                    escape(one["bin"]),
                    "-" if probability is None else f"{100 * probability:.0f}",
                    escape(one["why"].partition(": ")[2]) + note,
                )
            )
        print_table(("item", "bin", ">probability, %", "reason"), rows, console=console)
        console.print()
        summary = document["summary"]
        is_judged = summary["purity"] is not None
        bins = [
            (escape(name), str(one["items"]), *[str(one["right"])] * is_judged)
            for name, one in summary["bins"].items()
        ]
        print_table(("bin", ">items", *[">correct"] * is_judged), bins, console=console)
        parts = [f"{100 * summary['left_over']:.0f} % in the default bin {self.book.default_bin!r}"]
        if is_judged:
            purity = f"{100 * summary['purity']:.0f} % of the other items in the correct bin"
            parts.insert(1, purity)
        if self.dry:
            parts.append("dry run: nothing was grasped or written")
        else:
            parts.append(f"{summary['grasps_per_item']:.1f} grasps per item")
            parts.append(
                f"{summary['items_per_hour']:.0f} items per hour, assuming {CARRY_S:g} s handling "
                f"and {TURN_S:g} s turning per item"
            )
        if self._simulated:
            parts.append("simulated")
        console.print("; ".join(parts), markup=False)


def _row(one: Sorted, placed: Placed) -> dict[str, Any]:
    identity, size = one.identity, one.size_mm
    return {
        "item_id": one.item_id,
        "bin": one.decision.bin,
        "belongs": placed.true_bin,
        "rule_line": None if one.decision.rule is None else one.decision.rule.line,
        "probability": one.decision.probability,
        "why": one.decision.why,
        "kind": None if identity is None else identity.kind,
        "kind_probability": None if identity is None else dict(identity.probability),
        "size_mm": None if size is None else size.to_dict(),
        "grasps": placed.grasps,
        "grasping_s": round(placed.grasping_s, 3),
    }
