"""English of the code: names of functions, and the length of docstrings."""

from __future__ import annotations

import ast
import subprocess
from pathlib import Path

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


#: Units at the end of a name; a participle before one alone is without its noun.
UNITS = frozenset(["s", "ms", "mm", "n", "hz", "sd", "ma", "kpa", "ohm"])

ROOT = Path(__file__).resolve().parents[2]
LONGEST_FIRST_LINE = 15


def list_files(*, tests: bool) -> list[Path]:
    """Return all Python files that are kept with the project."""
    command = ["git", "ls-files", "*.py"]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [ROOT / name for name in names.split() if tests or "test" not in name]


def list_functions(source: str) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return [node for node in ast.walk(ast.parse(source)) if isinstance(node, kinds)]


def is_property(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return any("property" in ast.unparse(mark) for mark in function.decorator_list)


def is_misnamed(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """A function begins with no participle; a property does if a noun follows it."""
    first, *others = function.name.strip("_").split("_")
    has_noun = is_property(function) and any(word not in UNITS for word in others)
    return is_participle(first) and not has_noun


def test_function_name_begins_with_no_participle() -> None:
    found = [
        f"{file.relative_to(ROOT)}:{node.lineno} {node.name}"
        for file in list_files(tests=False)
        for node in list_functions(file.read_text())
        if is_misnamed(node)
    ]
    assert not found


def test_docstring_first_line_has_at_most_15_words() -> None:
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    found = [
        f"{file.relative_to(ROOT)}: {line}"
        for file in list_files(tests=True)
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, kinds)
        for line in (ast.get_docstring(node) or "").splitlines()[:1]
        if len(line.split()) > LONGEST_FIRST_LINE
    ]
    assert not found


def test_misnamed_functions_are_recognised() -> None:
    source = """
def learned(): ...
class Some:
    @property
    def known_ends(self): ...
    @property
    def lasted_s(self): ...
"""
    found = {node.name for node in list_functions(source) if is_misnamed(node)}
    assert found == {"learned", "lasted_s"}


def test_participles_are_recognised() -> None:
    words = ("fitted", "begun", "left", "read", "put", "speed", "predict", "feed")
    assert [is_participle(word) for word in words] == [True] * 3 + [False] * 5
