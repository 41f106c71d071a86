"""Mutation score of a module: the fraction of random small faults that its tests detect.

    python benchmarks/mutation.py src/palpate/sensor/wire.py tests/unit/sensor/test_wire.py

Each fault is inserted in a copy of the package; the tests run on it until the first failure.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: A mutant that runs longer than this counts as detected.
_TIMEOUT_S = 120
_COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}


def list_changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Yield the possible mutations of a node, each with a name."""
    if isinstance(node, ast.Compare):
        other = copy.deepcopy(node)
        other.ops[0] = _COMPARED[type(node.ops[0])]()
        yield "comparison", other
    elif isinstance(node, ast.BoolOp):
        other_op = copy.deepcopy(node)
        other_op.op = ast.And() if isinstance(node.op, ast.Or) else ast.Or()
        yield "and/or", other_op
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield "not", copy.deepcopy(node.operand)
    elif isinstance(node, ast.Constant):
        if isinstance(node.value, bool):
            yield "truth", ast.Constant(not node.value)
        elif isinstance(node.value, int | float):
            yield "number", ast.Constant(node.value + 1)
        elif isinstance(node.value, str) and node.value:
            yield "text", ast.Constant("")
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call | ast.Await):
        yield "call", ast.Pass()
    elif isinstance(node, ast.Return) and not _is_none(node.value):
        yield "return", ast.Return(ast.Constant(None))
    elif isinstance(node, ast.Raise):
        yield "raise", ast.Pass()
    elif isinstance(node, ast.AugAssign | ast.Delete):
        yield "statement", ast.Pass()


def _is_none(value: ast.expr | None) -> bool:
    return value is None or (isinstance(value, ast.Constant) and value.value is None)


def list_mutations(tree: ast.AST) -> Iterator[tuple[ast.AST, str, int | None, str, ast.AST]]:
    """Yield every mutation with its parent, field and index, without those of messages."""
    for parent in ast.walk(tree):
        # Messages, documentation and annotations do not affect the behaviour.
        if isinstance(parent, ast.JoinedStr | ast.Raise | ast.AnnAssign | ast.arg | ast.Expr):
            continue
        for field, value in ast.iter_fields(parent):
            if field in ("annotation", "returns"):
                continue
            if isinstance(value, ast.AST):
                yield from ((parent, field, None, *change) for change in list_changes(value))
            elif isinstance(value, list):
                for index, child in enumerate(value):
                    if isinstance(child, ast.AST):
                        yield from (
                            (parent, field, index, *change) for change in list_changes(child)
                        )


def create_mutants(source: str) -> list[tuple[str, str]]:
    """Return each mutation's description and the mutated module."""
    made = []
    for number in range(sum(1 for _ in list_mutations(ast.parse(source)))):
        tree = ast.parse(source)
        parent, field, index, kind, new = list(list_mutations(tree))[number]
        held = getattr(parent, field)
        old = held if index is None else held[index]
        what = f"line {old.lineno}: {kind}: {ast.unparse(old)[:70]} -> {ast.unparse(new)[:70]}"
        if index is None:
            setattr(parent, field, new)
        else:
            held[index] = new
        made.append((what, ast.unparse(ast.fix_missing_locations(tree))))
    return made


def is_detected(tests: list[str], *, package: Path) -> bool:
    """Return whether a test fails with the package in a folder."""
    environment = os.environ | {"PYTHONPATH": str(package)}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    try:
        ended = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, timeout=_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return True
    return ended.returncode != 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("module", type=Path)
    parser.add_argument("tests", nargs="+")
    parser.add_argument("-n", type=int, default=60, help="mutants drawn")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    within = options.module.resolve().relative_to(ROOT / "src")
    source = (ROOT / "src" / within).read_text()
    every = create_mutants(source)
    drawn = random.Random(options.seed).sample(every, min(options.n, len(every)))
    survived = []
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "src" / "palpate", Path(folder) / "palpate")
        if is_detected(options.tests, package=Path(folder)):
            raise SystemExit("the tests fail without a fault")
        for what, text in drawn:
            (Path(folder) / within).write_text(text)
            if not is_detected(options.tests, package=Path(folder)):
                survived.append(what)
                print(what, flush=True)
    detected_fraction = 1 - len(survived) / len(drawn)
    print(
        f"{within}: {len(drawn) - len(survived)} of {len(drawn)} detected "
        f"({detected_fraction:.0%}), drawn from {len(every)}"
    )


if __name__ == "__main__":
    main()
