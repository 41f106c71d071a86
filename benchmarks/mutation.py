"""Mutation score of a module: how many small faults, drawn by chance, its tests notice.

    python benchmarks/mutation.py src/palpate/sensor/wire.py tests/unit/sensor/test_wire.py

Each fault is made in a copy of the package; the tests run against it until the first failure.
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
#: A mutant that runs longer than this hangs: it is noticed.
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


def changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Yield what may stand in the place of a node, each with a name."""
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
    elif isinstance(node, ast.Return) and not _nothing(node.value):
        yield "return", ast.Return(ast.Constant(None))
    elif isinstance(node, ast.Raise):
        yield "raise", ast.Pass()
    elif isinstance(node, ast.AugAssign | ast.Delete):
        yield "statement", ast.Pass()


def _nothing(value: ast.expr | None) -> bool:
    return value is None or (isinstance(value, ast.Constant) and value.value is None)


def places(tree: ast.AST) -> Iterator[tuple[ast.AST, str, int | None, str, ast.AST]]:
    """Yield every change with its parent, field and index; text for people is left alone."""
    for parent in ast.walk(tree):
        # The wording of errors, documentation and annotations decide nothing.
        if isinstance(parent, ast.JoinedStr | ast.Raise | ast.AnnAssign | ast.arg | ast.Expr):
            continue
        for field, value in ast.iter_fields(parent):
            if field in ("annotation", "returns"):
                continue
            if isinstance(value, ast.AST):
                yield from ((parent, field, None, *change) for change in changes(value))
            elif isinstance(value, list):
                for index, child in enumerate(value):
                    if isinstance(child, ast.AST):
                        yield from ((parent, field, index, *change) for change in changes(child))


def mutants(source: str) -> list[tuple[str, str]]:
    """Return what each fault is and the module with it."""
    made = []
    for number in range(sum(1 for _ in places(ast.parse(source)))):
        tree = ast.parse(source)
        parent, field, index, kind, new = list(places(tree))[number]
        held = getattr(parent, field)
        old = held if index is None else held[index]
        what = f"line {old.lineno}: {kind}: {ast.unparse(old)[:70]} -> {ast.unparse(new)[:70]}"
        if index is None:
            setattr(parent, field, new)
        else:
            held[index] = new
        made.append((what, ast.unparse(ast.fix_missing_locations(tree))))
    return made


def is_noticed(tests: list[str], *, package: Path) -> bool:
    """Return whether a test fails with the package that lies in a folder."""
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
    told = parser.parse_args()
    within = told.module.resolve().relative_to(ROOT / "src")
    source = (ROOT / "src" / within).read_text()
    every = mutants(source)
    drawn = random.Random(told.seed).sample(every, min(told.n, len(every)))
    survived = []
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "src" / "palpate", Path(folder) / "palpate")
        if is_noticed(told.tests, package=Path(folder)):
            raise SystemExit("the tests fail without a fault")
        for what, text in drawn:
            (Path(folder) / within).write_text(text)
            if not is_noticed(told.tests, package=Path(folder)):
                survived.append(what)
                print(what, flush=True)
    share = 1 - len(survived) / len(drawn)
    print(
        f"{within}: {len(drawn) - len(survived)} of {len(drawn)} noticed ({share:.0%}), "
        f"drawn from {len(every)}"
    )


if __name__ == "__main__":
    main()
