"""Hash the code of a study to detect later changes.

The hash covers the syntax tree; comments, docstrings and formatting do not change it.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from pathlib import Path

import palpate
import palpate_studies
from palpate_studies.catalogue import STUDIES

_ROOTS = {
    str(package.__name__): Path(str(package.__file__)).parent
    for package in (palpate, palpate_studies)
}
#: Modules of presentation, on which no figure depends.
_PRESENTATION = (
    "palpate.cli",
    "palpate.plots",
    "palpate_studies.report",
)


def code_hash(study: str) -> str:
    """Return the SHA-256 of all product and study files that a study imports.

    JSON files in their folders are included; presentation modules are not.
    """
    found = hashlib.sha256()
    for path in study_files(study):
        found.update(_show_path(path).encode() + _read_code(path))
    return found.hexdigest()


def _read_code(path: Path) -> bytes:
    """Return the syntax tree of a Python file without docstrings, or a file's bytes.

    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "one.py"
    >>> texts = "def f(): 'Say.'; return 1", "def f(): return (1)  # so", "def f(): return 2"
    >>> one, same, other = ((file.write_text(text), _read_code(file))[1] for text in texts)
    >>> one == same, same == other
    (True, False)
    """
    if path.suffix != ".py":
        return path.read_bytes()
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(
            node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
        ) and ast.get_docstring(node, clean=False):
            # A body must not become empty.
            node.body = node.body[1:] or [ast.Pass()]
    return ast.dump(tree).encode()


def study_files(study: str) -> list[Path]:
    """Return the files of a study's hash, in the order of hashing.

    Examples
    --------
    >>> names = {path.stem for path in study_files("rupture")}
    >>> "damage_learning" in names, "controller" in names
    (True, False)
    """
    modules, waiting = dict[str, Path](), [STUDIES[study][0]]
    while waiting:
        name = waiting.pop()
        path = None if name in modules or name.startswith(_PRESENTATION) else _file_of(name)
        if path is not None:
            modules[name] = path
            waiting += [*_list_imports(path), name.rpartition(".")[0]]
    in_folders = {one for path in modules.values() for one in path.parent.glob("*.json")}
    return sorted({*modules.values(), *in_folders}, key=_show_path)


def _file_of(name: str) -> Path | None:
    top, *parts = name.split(".")
    if top not in _ROOTS:
        return None
    place = _ROOTS[top].joinpath(*parts)
    path = place / "__init__.py" if place.is_dir() else place.with_name(f"{place.name}.py")
    return path if path.is_file() else None


def _list_imports(path: Path) -> Iterator[str]:
    """Yield all names that a file imports at run time, modules and others."""
    waiting: list[ast.AST] = [ast.parse(path.read_text())]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            waiting += node.orelse
            continue
        if isinstance(node, ast.Import):
            yield from (one.name for one in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{one.name}" for one in node.names)
        waiting += ast.iter_child_nodes(node)


def _show_path(path: Path) -> str:
    return next(
        f"{name}/{path.relative_to(root).as_posix()}"
        for name, root in _ROOTS.items()
        if path.is_relative_to(root)
    )
