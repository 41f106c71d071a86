"""Results of studies that pages quote: how each is made, and whether its code has changed since.

`docs/results.toml` states the study, options and origin of each result; `docs/kept` contains the
figures with their date, processor time and the content of the code that made them.
"""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any

from palpate.errors import InputError
from palpate.files import atomic_path
from palpate_studies.catalogue import STUDIES
from palpate_studies.study_code import ProductCode

#: The command of this interpreter's palpate, which need not be on the path.
_RUN = "import sys; from palpate.cli import main; sys.exit(main())"
#: Endings of the arguments that name a file in the folder of real recordings.
_DATA_ENDINGS = (".csv", ".csv.gz")
#: Changed modules that a reason names.
_SHOWN_MODULES = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """How a result is made.

    Attributes
    ----------
    name : str
        Name of the result and its file.
    study : str
        Study with its options; files without their folder.
    keys : tuple of str
        Keys of the study's JSON document that pages may quote; no rows of single cases.
    origin : {"real", "simulated"}
        Origin of the data.
    note : str
        Seeds, number of evaluations on the test set, and reductions of the run.
    symbols : frozenset of str
        ``"module:name"`` of the study and of the code that the claims on this result name.
    earlier : str
        Why the result is of an earlier version; empty for a result of the present code.
    """

    name: str
    study: str
    keys: tuple[str, ...]
    origin: str
    note: str
    symbols: frozenset[str]
    earlier: str = ""

    @property
    def command(self) -> str:
        """Return the command that makes the result."""
        return f"palpate study {self.study}"


def read_recipes(docs: Path) -> dict[str, Recipe]:
    """Return how each result is made, by name.

    Raises
    ------
    InputError
        If a claim quotes a result that is not in `results.toml`.
    """
    rows = tomllib.loads((docs / "results.toml").read_text(encoding="utf-8"))
    symbols = {
        name: {f"{STUDIES[row['study'].split()[0]][0]}:command", *row.pop("code", ())}
        for name, row in rows.items()
    }
    for claim in tomllib.loads((docs / "claims.toml").read_text(encoding="utf-8"))["claim"]:
        for key in ("result", "second_result"):
            if key in claim:
                if claim[key] not in rows:
                    raise InputError(f"claims.toml: results.toml has no {claim[key]!r}")
                symbols[claim[key]].add(claim["code"])
    return {
        name: Recipe(
            name=name, symbols=frozenset(symbols[name]), **row | {"keys": tuple(row["keys"])}
        )
        for name, row in rows.items()
    }


@cache
def read_result(docs: Path, name: str) -> dict[str, Any]:
    """Read a stored result."""
    found: dict[str, Any] = json.loads((docs / "kept" / f"{name}.json").read_text("utf-8"))
    return found


def explain_outdated(recipe: Recipe, *, docs: Path, code: ProductCode) -> str:
    """Return why a stored result must be made again; empty for a current one."""
    if not (docs / "kept" / f"{recipe.name}.json").is_file():
        return "not made"
    stored = read_result(docs, recipe.name)
    if stored["command"] != recipe.command:
        return f"made with `{stored['command']}`"
    then, now = stored["code"], code.hash_content(recipe.symbols)
    changed = [one for one in sorted(then | now) if then.get(one) != now.get(one)]
    return f"changed: {_show_modules(changed)}" if changed else ""


def _show_modules(names: Sequence[str]) -> str:
    rest = f" and {len(names) - _SHOWN_MODULES} more" if len(names) > _SHOWN_MODULES else ""
    return ", ".join(names[:_SHOWN_MODULES]) + rest


def make_result(recipe: Recipe, *, docs: Path, data: Path) -> float:
    """Run the study of a result, store the figures, and return its processor time in seconds.

    Raises
    ------
    InputError
        If a file of real recordings is missing or the study fails.
    """
    arguments = shlex.split(recipe.study)
    files = {one: data / one for one in arguments if one.endswith(_DATA_ENDINGS)}
    for path in files.values():
        if not path.is_file():
            raise InputError(f"{recipe.name}: {path} is missing; set PALPATE_REAL_DATA")
    # Computed before the run, because the code may change meanwhile.
    content = ProductCode().hash_content(recipe.symbols)
    with subprocess.Popen(
        [sys.executable, "-c", _RUN, "study", *(str(files.get(a, a)) for a in arguments), "--json"],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        printed = process.stdout.read()
        # With the processes of the study, which it waits for.
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise InputError(f"{recipe.name}: the study ended with status {process.returncode}")
    document, processor_s = json.loads(printed), usage.ru_utime + usage.ru_stime
    store_result(
        recipe,
        docs=docs,
        figures={key: document[key] for key in recipe.keys},
        code=content,
        processor_s=processor_s,
    )
    return processor_s


def store_result(
    recipe: Recipe,
    *,
    docs: Path,
    figures: Mapping[str, Any],
    code: Mapping[str, str],
    processor_s: float,
) -> Path:
    """Write the figures of a study to `docs/kept`, with their command, date, time and code.

    `code` is `ProductCode.hash_content` at the start of the study.
    """
    document = {
        "command": recipe.command,
        "made_on": date.today().isoformat(),
        "processor_s": round(processor_s),
        "code": dict(sorted(code.items())),
        "figures": figures,
    }
    path = docs / "kept" / f"{recipe.name}.json"
    with atomic_path(path) as partial:
        partial.write_text(json.dumps(document, allow_nan=False, indent=1) + "\n")
    return path
