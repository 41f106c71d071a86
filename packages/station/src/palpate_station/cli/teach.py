"""`palpate teach`: learn a label from grasps and report the accuracy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from palpate.cli.options import JsonOption, StoreOption, opt, refuse_options
from palpate.cli.output import format_percent, print_json, print_message
from palpate.errors import InputError
from palpate.terminal_table import make_console, print_table
from palpate_station.cli.items import open_store
from palpate_station.learning import LabelLearner, LabelledTable, LearnedScore
from palpate_station.records import About
from palpate_station.store import Store
from palpate_station.store.labels import add_label
from palpate_station.training_tables import read_labelled, read_labels_about


class Question(StrEnum):
    """The subject of the labels."""

    KIND = "kind"
    BRUISE = "bruise"
    RIPENESS = "ripeness"
    GRADE = "grade"


#: Maximum number of left out items that are named.
_NAMED = 10
#: Question -> subject of the verdicts that label it.
_ABOUT = {
    Question.KIND: About.IDENTITY,
    Question.BRUISE: About.BRUISE,
    Question.RIPENESS: About.RIPENESS,
    Question.GRADE: About.BIN,
}


def teach(
    question: Annotated[Question, typer.Argument(help="The subject of the labels.")],
    table: Annotated[
        Path | None,
        opt(
            "--table FILE",
            "Learn from a CSV with columns item_id, label and numbers, instead of the store.",
        ),
    ] = None,
    kind: Annotated[str | None, opt("--kind", "Learn from stored items of this kind.")] = None,
    labels: Annotated[
        list[str] | None,
        opt("--say ITEM=LABEL", "Label a stored item before learning; may be repeated."),
    ] = None,
    store: StoreOption = None,
    as_json: JsonOption = False,
) -> None:
    """Learn a label from grasps, report the accuracy, and name unlabelled items.

    Linear discriminant analysis, logistic regression and boosted trees are compared by
    cross-validation over items, and the best method is used. Grades are bin labels (--say
    ITEM=LABEL).

    Example: palpate teach grade --kind avocado --say A17=firm
    """
    about = _ABOUT[question]
    if table is not None:
        given = {"--kind": kind, "--say": labels and labels[0], "--store": store}
        refuse_options(given, why=f"can't be combined with --table {table}")
        known = read_labelled(table)
    else:
        with open_store(store, create=bool(labels)) as opened:
            _label_items(opened, labels or [], about=about)
            known = read_labels_about(opened, about, kind=kind)
    # Before an error that too few items remain.
    if known.left_out:
        print_message(f"palpate: {_describe_left_out(known.left_out)}")
    learner = known.learn(allow_unknown=question is Question.KIND)
    score, named = learner.score(), _name_unlabelled(known, learner)
    if as_json:
        print_json(
            {
                "question": str(question),
                "features": list(known.features),
                "method": learner.method,
                "items": score.items,
                "right": score.right,
                "right_by_chance": score.right_by_chance,
                "log_loss": score.log_loss,
                "overconfidence": score.overconfidence,
                "confusion": score.confusion,
                "named": named,
                "left_out": dict(known.left_out),
            }
        )
    else:
        _print(score, named, method=learner.method, labels=learner.labels)


def _label_items(store: Store, texts: Sequence[str], *, about: About) -> None:
    for text in texts:
        item, equals, label = text.partition("=")
        if not equals or not label.strip():
            raise InputError(f"--say {text}: must be ITEM=LABEL")
        store.item(item)
        add_label(store, item, about=about, text=label.strip())


def _describe_left_out(left_out: Mapping[str, str]) -> str:
    """Return how many labelled items have no row, which and why."""
    names = [f"{item} ({name})" for item, name in left_out.items()]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return (
        f"left out: {len(names)} labelled items without a grasp that measured the quantity in "
        f"brackets: {', '.join(names[:_NAMED])}{more}; grasp them again, more firmly"
    )


def _name_unlabelled(known: LabelledTable, learner: LabelLearner) -> list[dict[str, Any]]:
    """Return the predicted label of each unlabelled item, for the JSON output."""
    blank = known.find_unlabelled()
    if not blank:
        return []
    rows = known.rows[blank]
    return [
        {"item_id": known.items[row], "label": str(label), "probability": float(chance.max())}
        for row, label, chance in zip(
            blank, learner.predict(rows), learner.probabilities(rows), strict=True
        )
    ]


def _print(
    score: LearnedScore, named: Sequence[dict[str, Any]], *, method: str, labels: Sequence[str]
) -> None:
    console = make_console()
    console.print(
        f"{score.items} labelled items, {method}: {format_percent(score.right)} named "
        f"correctly when held out ({format_percent(score.right_by_chance)} for the most common "
        f"label); mean probability minus accuracy {100 * score.overconfidence:+.0f} points",
        markup=False,
    )
    print_table(
        ("label \\ prediction", *(f">{label}" for label in labels)),
        [
            (escape(true), *(str(row.get(label, 0)) for label in labels))
            for true, row in score.confusion.items()
        ],
        console=console,
    )
    if named:
        print_table(
            ("item", "label", ">probability"),
            [
                (escape(one["item_id"]), escape(one["label"]), format_percent(one["probability"]))
                for one in named
            ],
            console=console,
        )
