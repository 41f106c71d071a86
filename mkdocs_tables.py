"""Tables of the reference pages, generated from the code.

`docs/generate_tables.py` writes each table below the line `<!-- table: NAME -->` of its page.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, get_type_hints

import griffe

from palpate.cli.grasp import EXIT_STATUS
from palpate.grasp.config import rows
from palpate.grasp.result import Outcome
from palpate.grasp.verdict import outcome_text
from palpate.gripper import dynamixel, feetech, hobby_servo, pneumatic
from palpate.recording.channels import SCHEMAS
from palpate.rig.file import describe_type
from palpate.sensor.board_array import find_layout, open_board


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def _outcomes() -> str:
    """Return every outcome of a grasp with its meaning and the command's exit status."""
    return _table(
        ("outcome", "meaning", "exit status of `palpate grasp`"),
        ((f"`{one}`", outcome_text(one), EXIT_STATUS[one]) for one in Outcome),
    )


def _schema(path: Path) -> str:
    """Return the top-level fields of a JSON schema."""
    fields = _fields(json.loads(path.read_text(encoding="utf-8")))
    return _table(
        ("field and type", "meaning"),
        ((f"`{name}` {kind}", meaning) for name, kind, meaning in fields),
    )


def _schemas() -> str:
    """Return the document and the link of every published schema."""
    documents = {path: json.loads(path.read_text()) for path in sorted(_SCHEMAS.glob("*.json"))}
    return _table(
        ("document", "schema"),
        ((one["title"], f"[{path.name}](schemas/{path.name})") for path, one in documents.items()),
    )


def _fields(schema: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield name, type and meaning of the fields of a JSON schema."""
    for name, field in schema["properties"].items():
        kind = _type(field) + ("" if name in schema["required"] else ", optional")
        yield name, kind, field.get("description", "")


def _type(field: dict[str, Any]) -> str:
    """Return the type of a field; a question mark means "or null"."""
    if "$ref" in field:
        return "[measurement](#measurement)"
    if field.get("type") == "null":
        return "null"
    if "enum" in field:
        known = [f"`{one}`" for one in field["enum"] if one is not None]
        return " ".join(known) + ("?" if None in field["enum"] else "")
    if "anyOf" in field:
        kinds = [_type(one) for one in field["anyOf"]]
    else:
        kinds = field["type"] if isinstance(field["type"], list) else [field["type"]]
        inner = field.get("items", {})
        of = f" of {_type(inner)}" if inner and "properties" not in inner else ""
        kinds = [kind + (of if kind == "array" else "") for kind in kinds]
    return "/".join(kind for kind in kinds if kind != "null") + ("?" if "null" in kinds else "")


def _topics() -> str:
    """Return the fields of a recording's messages, by topic."""
    return _table(
        ("topic", "field", "type", "meaning"),
        (
            (f"`{topic}`", f"`{name}`", kind, meaning)
            for topic, schema in SCHEMAS.items()
            for name, kind, meaning in _fields(schema)
        ),
    )


def _keys(opener: Callable[..., object], *described: Callable[..., object], **other: str) -> str:
    """Return the keys of a rig file's table: an opener's parameters with their docstrings.

    Parameters with the same text share a row.

    If the opener's docstring refers to another function ("As in"), the text of that function in
    `described` is used. `other` maps a parameter to its name in that function.
    """
    meanings: dict[str, str] = {}
    for source in (*described, opener):
        for section in griffe.Docstring(inspect.getdoc(source) or "").parse("numpy"):
            if section.kind is griffe.DocstringSectionKind.parameters:
                for one in section.value:
                    if not one.description.startswith("As in") or one.name not in meanings:
                        meanings[one.name] = " ".join(one.description.split())
    meanings |= {name: meanings[there] for name, there in other.items()}
    hints = get_type_hints(opener)
    rows: dict[str, list[tuple[str, str, str]]] = {}
    for name, parameter in inspect.signature(opener).parameters.items():
        # Not a key of the file: `open_rig` passes the open array.
        if name != "array":
            kind = describe_type(hints[name]).removeprefix("a ").removeprefix("one of ")
            row = (f"`{name}`", kind, _default(parameter.default))
            rows.setdefault(meanings[name], []).append(row)
    return _table(
        ("key", "value", "default", "meaning"),
        (
            (
                *(
                    ", ".join(filter(None, dict.fromkeys(cells)))
                    for cells in zip(*alike, strict=True)
                ),
                meaning,
            )
            for meaning, alike in rows.items()
        ),
    )


def _default(value: object) -> str:
    if value is inspect.Parameter.empty:
        return "required"
    return "" if value is None else f"`{json.dumps(value)}`"


_SCHEMAS = Path(__file__).resolve().parent / "docs" / "schemas"


def _grasp_numbers() -> str:
    """Return every tuned number of a grasp; a ratio has no unit."""
    return _table(
        ("number", "value (range)", "source", "quantity"),
        (
            (f"`{name}`", f"{value} {'' if unit == '1' else f'{unit} '}({span})", source, quantity)
            for name, value, span, unit, source, quantity in rows()
        ),
    )


def _code(text: str) -> str:
    return "`" + text.replace("|", "\\|") + "`" if text else ""


#: Materials of the study `settled` -> names on the page.
_MATERIALS = {
    "cbsilicone": "silicone, resistance",
    "force_relaxation": "silicone, force",
    "velostat": "Velostat, resistance",
    "food": "food, force",
    "tape": "adhesive tape, force",
    "meat": "meat, force",
}
_CUTOFFS_S = (1.0, 2.5, 5.0)


def _settled() -> str:
    """Return the results of the settled value by material, from the stored study."""
    stored = Path(__file__).resolve().parent / "docs" / "kept" / "settled.json"
    figures = json.loads(stored.read_text(encoding="utf-8"))["figures"]
    rows = {
        (row["material"], row["cutoff_s"], row["own_holds"]): row
        for row in figures["rows"]
        if row["method"] == "ours"
    }
    relative = {
        (row["material"], row["cutoff_s"]): row["relative"]
        for row in figures["relative"]
        if row["own_holds"] == 0
    }
    own = {
        material: max(count for name, _, count in rows if name == material and count <= 12)
        for material in _MATERIALS
    }

    def join(values: Iterable[float]) -> str:
        return " / ".join(f"{value:.2f}" for value in values)

    return _table(
        (
            "material",
            "holds",
            "error / best simple rule",
            "coverage (0.9)",
            "error at 2.5 s, %",
            "half-width, %",
            "with own holds, %",
        ),
        (
            (
                name,
                rows[material, 2.5, 0]["holds"],
                join(relative[material, cutoff_s] for cutoff_s in _CUTOFFS_S),
                join(rows[material, cutoff_s, 0]["coverage"] for cutoff_s in _CUTOFFS_S),
                f"{rows[material, 2.5, 0]['median_abs_error_percent']:.2g}",
                f"{rows[material, 2.5, 0]['half_width_percent']:.2g}",
                f"{rows[material, 2.5, own[material]]['median_abs_error_percent']:.2g} "
                f"({own[material]})",
            )
            for material, name in _MATERIALS.items()
        ),
    )


TABLES: dict[str, Callable[[], str]] = {
    "settled": _settled,
    "grasp-numbers": _grasp_numbers,
    "schemas": _schemas,
    "outcomes": _outcomes,
    "topics": _topics,
    "board": partial(_keys, open_board, find_layout, layout="name"),
    "dynamixel": partial(_keys, dynamixel.open_gripper, dynamixel.DynamixelGripper),
    "feetech": partial(_keys, feetech.open_gripper, feetech.FeetechGripper),
    "pneumatic": partial(_keys, pneumatic.open_gripper),
    "servo": partial(_keys, hobby_servo.open_gripper),
    **{path.stem: partial(_schema, path) for path in sorted(_SCHEMAS.glob("*.json"))},
}
