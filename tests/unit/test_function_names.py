"""Functions are named by verbs: none begins with a participle."""

from __future__ import annotations

import ast
from pathlib import Path

import palpate

#: Irregular participles that are no verbs in the same form, and words in -ed that are none.
IRREGULAR = frozenset(
    [
        "begun",
        "swept",
        "stood",
        "known",
        "told",
        "felt",
        "held",
        "met",
        "kept",
        "given",
        "taken",
        "seen",
        "found",
        "left",
        "lost",
        "said",
        "shown",
        "drawn",
        "written",
        "chosen",
        "sent",
        "gone",
        "done",
        "built",
        "bought",
        "brought",
        "caught",
        "driven",
        "fed",
        "laid",
        "led",
        "meant",
        "paid",
        "sold",
        "spoken",
        "stuck",
        "thrown",
        "torn",
        "understood",
        "unknown",
        "withdrawn",
        "wound",
        "risen",
        "made",
    ]
)
NO_PARTICIPLES = frozenset({"need", "speed", "seed", "feed", "exceed", "proceed", "embed"})


def is_participle(word: str) -> bool:
    return word in IRREGULAR or (
        word.endswith("ed") and len(word) > 3 and word not in NO_PARTICIPLES
    )


def is_property(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return any("property" in ast.unparse(mark) for mark in function.decorator_list)


def test_function_name_begins_with_no_participle() -> None:
    found = [
        f"{file.name}:{node.lineno} {node.name}"
        for file in Path(palpate.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and is_participle(node.name.strip("_").split("_")[0])
        and not is_property(node)
    ]
    assert not found


def test_participles_are_recognised() -> None:
    words = ("fitted", "begun", "left", "read", "put", "speed", "predict", "feed")
    assert [is_participle(word) for word in words] == [True] * 3 + [False] * 5
