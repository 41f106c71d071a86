"""Count lines of code, files and imports of each package.

    python benchmarks/code_lines.py [--folders]

A line of code is not blank, comment or docstring. The longest path is the largest number of modules
that import each other in a row, without imports inside functions and for types alone.
"""

from __future__ import annotations

import argparse
import ast
import io
import tokenize
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def count_lines(text: str) -> int:
    """Return the lines that hold code."""
    quiet = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
    used = {
        number
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type not in (*quiet, tokenize.ENDMARKER)
        for number in range(token.start[0], token.end[0] + 1)
    }
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            assert node.end_lineno is not None
            used -= set(range(node.lineno, node.end_lineno + 1))
    return len(used)


def name_module(file: Path, source: Path) -> str:
    """Return the dotted name of a file below a folder of sources."""
    parts = file.relative_to(source).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def list_imports(tree: ast.Module, known: set[str]) -> set[str]:
    """Return the known modules that a module imports when it is loaded."""
    found = set[str]()
    for node in tree.body:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names} & known or {
                node.module
            }
    return found & known


def longest_path(graph: dict[str, set[str]]) -> list[str]:
    """Return the longest row of modules in which each imports the next."""

    @cache
    def follow(name: str) -> tuple[str, ...]:
        return (name, *max((follow(one) for one in graph[name] - {name}), key=len, default=()))

    return list(max((follow(name) for name in graph), key=len, default=()))


def main() -> None:
    """Print one row for each distribution, or for each folder of them."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n")[0])
    parser.add_argument("--folders", action="store_true", help="one row for each folder")
    options = parser.parse_args()
    print(f"{'':40}{'files':>6}{'code lines':>12}{'longest path':>14}")
    for source in (ROOT / "src", *sorted(ROOT.glob("packages/*/src"))):
        for package in sorted(one for one in source.iterdir() if one.is_dir()):
            files = {name_module(file, source): file for file in package.rglob("*.py")}
            trees = {name: ast.parse(file.read_text()) for name, file in files.items()}
            graph = {name: list_imports(tree, set(files)) for name, tree in trees.items()}
            lines = {name: count_lines(file.read_text()) for name, file in files.items()}
            path = longest_path(graph)
            print(f"{package.name:40}{len(files):6}{sum(lines.values()):12}{len(path):14}")
            if options.folders:
                groups: dict[str, list[int]] = {}
                for name, count in lines.items():
                    parts = name.split(".")
                    is_folder = len(parts) > 1 and (package / parts[1]).is_dir()
                    groups.setdefault(parts[1] if is_folder else "(modules)", []).append(count)
                for name, counts in sorted(groups.items()):
                    print(f"    {name:36}{len(counts):6}{sum(counts):12}")
                print("    longest: " + " > ".join(path))


if __name__ == "__main__":
    main()
