"""Content of the product code behind a result, to detect later changes of that code.

The content of a symbol is its definition and every definition of palpate that it refers to,
directly or through others: a whole class, but of a module only the names in use. A change elsewhere
in a module is therefore no change. Comments, docstrings, formatting and texts of raised errors are
not part of the content.

Modules of presentation and of errors are left out, because no figure depends on them, so is the
twin unless a result is about it: it is the world of a study, not the claimed code. The code of
studies is followed, because it names the product code that makes the figures, but is not part of
the content either. After a change of the world or of a study, make its results again by name.
"""

from __future__ import annotations

import ast
import hashlib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import palpate
import palpate_station
import palpate_studies

_STUDIES = palpate_studies.__name__
#: Package -> folder.
PACKAGES: Mapping[str, Path] = {
    package.__name__: Path(str(package.__file__)).parent
    for package in (palpate, palpate_station, palpate_studies)
}
_PRESENTATION = (
    "palpate.cli",
    "palpate_station.cli",
    "palpate_station.dashboard",
    "palpate_station.plots",
    "palpate.errors",
    "palpate.plots",
    "palpate.terminal_table",
    "palpate_studies.report",
)
_TWIN = "palpate.twin"
#: Name of the statements of a module that define no name.
_OTHER = ""

#: (module, name) of a definition.
Definition: TypeAlias = tuple[str, str]


@dataclass(frozen=True)
class _Module:
    #: Name -> statements that define it.
    definitions: Mapping[str, list[ast.stmt]]
    #: Name -> dotted name of the imported module or symbol.
    imports: Mapping[str, str]


class ProductCode:
    """The definitions of palpate and its studies, and which of them a symbol needs.

    Parameters
    ----------
    packages : mapping
        Folder of each package.

    Examples
    --------
    >>> found = ProductCode().find_definitions(["palpate_studies.rupture:command"])
    >>> ("palpate.object.damage", "DamageModel") in found
    True
    >>> ("palpate.grasp.runner", "run_grasp") in found
    False
    """

    def __init__(self, packages: Mapping[str, Path] = PACKAGES) -> None:
        self._packages = packages
        self._read = cache(self._read_module)
        self._read_content = cache(self._read_content_of_one)
        self._list_needed = cache(self._list_needed_of_one)

    def hash_content(self, symbols: Iterable[str]) -> dict[str, str]:
        """Return module -> first 12 digits of the SHA-256 of its content that the symbols need.

        `symbols` are ``"module:name"``. There is a hash for each module, so that a difference names
        the changed modules.
        """
        content = defaultdict[str, list[bytes]](list)
        for module, name in sorted(self.find_definitions(symbols)):
            if module.split(".")[0] != _STUDIES:
                content[module].append(self._read_content(module, name))
        return {
            module: hashlib.sha256(b"\n".join(parts)).hexdigest()[:12]
            for module, parts in content.items()
        }

    def find_definitions(self, symbols: Iterable[str]) -> set[Definition]:
        """Return every definition of the product and the studies that the symbols need."""
        waiting = [(module, name) for module, _, name in (one.partition(":") for one in symbols)]
        about_twin = any(module.startswith(_TWIN) for module, _ in waiting)
        skipped = _PRESENTATION if about_twin else (*_PRESENTATION, _TWIN)
        found = set[Definition]()
        while waiting:
            one = waiting.pop()
            if one not in found and not one[0].startswith(skipped):
                if self._statements(*one):
                    found.add(one)
                waiting += self._list_needed(*one)
        return found

    def _statements(self, module: str, name: str) -> list[ast.stmt]:
        read = self._read(module)
        return [] if read is None else read.definitions.get(name, [])

    def _list_needed_of_one(self, module: str, name: str) -> list[Definition]:
        """Return what one definition refers to, or the origin of an imported name."""
        read = self._read(module)
        if read is None:
            return []
        if name not in read.definitions:
            return self._resolve(read.imports[name]) if name in read.imports else []
        found = [(module, _OTHER)] if _OTHER in read.definitions else []
        for statement in read.definitions[name]:
            imports = {**read.imports, **dict(_list_imports(statement))}
            for dotted in _list_names(statement):
                first, _, rest = dotted.partition(".")
                if first in read.definitions:
                    found.append((module, first))
                elif first in imports:
                    found += self._resolve(f"{imports[first]}.{rest}")
        return found

    def _resolve(self, dotted: str) -> list[Definition]:
        """Return the definition that a dotted name refers to; all definitions of a module."""
        parts = dotted.strip(".").split(".")
        for count in range(len(parts), 0, -1):
            module = ".".join(parts[:count])
            read = self._read(module)
            if read is not None:
                return [(module, name) for name in parts[count : count + 1] or read.definitions]
        return []

    def _read_module(self, module: str) -> _Module | None:
        path = self._find_file(module)
        if path is None:
            return None
        definitions, imports = defaultdict[str, list[ast.stmt]](list), dict[str, str]()
        if module == palpate.__name__:
            # Public names, which the package imports when they are used.
            stub = ast.parse(path.with_suffix(".pyi").read_text(encoding="utf-8"))
            for statement in stub.body:
                if isinstance(statement, ast.ImportFrom):
                    imports |= dict(_list_imports(statement))
        for statement in _list_statements(ast.parse(path.read_text(encoding="utf-8")).body):
            if isinstance(statement, ast.Import | ast.ImportFrom):
                imports |= dict(_list_imports(statement))
            else:
                for name in _list_defined(statement):
                    definitions[name].append(statement)
        return _Module(definitions, imports)

    def _find_file(self, module: str) -> Path | None:
        top, *parts = module.split(".")
        if top not in self._packages:
            return None
        place = self._packages[top].joinpath(*parts)
        path = place / "__init__.py" if place.is_dir() else place.with_name(f"{place.name}.py")
        return path if path.is_file() else None

    def _read_content_of_one(self, module: str, name: str) -> bytes:
        """Return the content of a definition and of the JSON files in its folder that it names."""
        statements, source = self._statements(module, name), self._find_file(module)
        assert source is not None
        texts = {
            str(node.value)
            for statement in statements
            for node in ast.walk(statement)
            if isinstance(node, ast.Constant) and str(node.value).endswith(".json")
        }
        files = [source.with_name(text) for text in sorted(texts) if "/" not in text]
        return b"\n".join(
            [
                repr((name, [_show(one) for one in statements])).encode(),
                *(path.read_bytes() for path in files if path.is_file()),
            ]
        )


def _list_statements(body: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """Yield the statements of a module, with those for type checking: they name classes in use."""
    for statement in body:
        if isinstance(statement, ast.If | ast.Try):
            yield from _list_statements([*statement.body, *statement.orelse])
        elif not (
            isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
        ) and not (isinstance(statement, ast.ImportFrom) and statement.module == "__future__"):
            yield statement


def _list_defined(statement: ast.stmt) -> list[str]:
    if isinstance(statement, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        return [statement.name]
    stored = [
        node.id
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    ]
    return stored or [_OTHER]


def _list_imports(statement: ast.stmt) -> Iterator[tuple[str, str]]:
    """Yield each name that a statement imports, at any depth, with its dotted origin."""
    for node in ast.walk(statement):
        if isinstance(node, ast.Import):
            for one in node.names:
                yield (one.asname, one.name) if one.asname else (2 * (one.name.split(".")[0],))
        elif isinstance(node, ast.ImportFrom):
            yield from ((one.asname or one.name, f"{node.module}.{one.name}") for one in node.names)


def _list_names(node: ast.AST) -> Iterator[str]:
    """Yield the names that a node refers to, as ``name`` or ``name.attribute``."""
    dotted = _dotted(node)
    if dotted:
        yield dotted
    elif isinstance(node, ast.Raise):
        yield from ()
    else:
        for child in ast.iter_child_nodes(node):
            yield from _list_names(child)


def _dotted(node: ast.AST) -> str:
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        start = _dotted(node.value)
        return f"{start}.{node.attr}" if start else ""
    return ""


def _show(node: Any) -> Any:
    """Return a syntax tree as nested tuples that are the same in every version of Python.

    >>> texts = "def f(): 'Say.'; return 1", "def f(): return (1)  # so", "def f(): return 2"
    >>> one, same, other = (_show(ast.parse(text)) for text in texts)
    >>> one == same, same == other
    (True, False)
    """
    if isinstance(node, list):
        return [_show(one) for one in node]
    if not isinstance(node, ast.AST):
        return node
    if isinstance(node, ast.Raise):
        return ("Raise",)
    fields = dict(ast.iter_fields(node))
    is_documented = isinstance(
        node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    ) and ast.get_docstring(node, clean=False)
    if is_documented:
        fields["body"] = fields["body"][1:]
    shown = ((name, _show(value)) for name, value in fields.items() if value not in (None, []))
    return (type(node).__name__, *shown)
