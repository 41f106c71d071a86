"""Make the stored results that pages quote again, those of earlier code or the named ones.

Usage: python docs/make_results.py [--list] [--jobs N] [--again] [NAME ...]

A result of the present code is skipped, so the command continues where it was stopped. Results on
the first page come first, then those that took least time. `docs/results.toml` states how each is
made; real recordings are in the folder $PALPATE_REAL_DATA.
"""

from __future__ import annotations

import argparse
import os
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from palpate.errors import InputError
from palpate_studies.stored_results import (
    Recipe,
    explain_outdated,
    make_result,
    read_recipes,
    read_result,
)
from palpate_studies.study_code import ProductCode

DOCS = Path(__file__).resolve().parent
DATA = Path(os.environ.get("PALPATE_REAL_DATA", DOCS.parents[1] / "shared" / "data"))


def main() -> int:
    """Make or list the results; the status is 1 if a study failed."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n")[0])
    parser.add_argument("names", metavar="NAME", nargs="*", help="results; default: all")
    parser.add_argument("--list", action="store_true", help="list outdated results and reasons")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="studies at the same time")
    parser.add_argument("--again", action="store_true", help="make current results again, too")
    options = parser.parse_args()
    recipes = read_recipes(DOCS)
    unknown = set(options.names) - set(recipes)
    if unknown:
        parser.error(f"no result {', '.join(sorted(unknown))}; available: {', '.join(recipes)}")
    code = ProductCode()
    reasons = {
        name: explain_outdated(recipes[name], docs=DOCS, code=code)
        or ("current, made again" if options.again else "")
        for name in options.names or recipes
    }
    waiting = sorted((name for name, reason in reasons.items() if reason), key=_order_key)
    for name in waiting:
        _report(f"{name} ({_show_time(name)}): {reasons[name]}")
    if options.list or not waiting:
        return 0
    pool = ThreadPoolExecutor(options.jobs)
    try:
        made = list(pool.map(_make, (recipes[name] for name in waiting)))
    finally:
        # After Ctrl-C no further study begins.
        pool.shutdown(cancel_futures=True)
    return 0 if all(made) else 1


def _order_key(name: str) -> tuple[bool, float]:
    claims = tomllib.loads((DOCS / "claims.toml").read_text(encoding="utf-8"))["claim"]
    is_first = any(one.get("first_page") and one["result"] == name for one in claims)
    return not is_first, _last_processor_s(name)


def _last_processor_s(name: str) -> float:
    try:
        return float(read_result(DOCS, name)["processor_s"])
    except (FileNotFoundError, KeyError):
        return float("inf")


def _show_time(name: str) -> str:
    processor_s = _last_processor_s(name)
    return (
        "time unknown"
        if processor_s == float("inf")
        else f"{processor_s / 60:.1f} min of one processor"
    )


def _report(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _make(recipe: Recipe) -> bool:
    try:
        processor_s = make_result(recipe, docs=DOCS, data=DATA)
    except InputError as problem:
        _report(str(problem))
        return False
    _report(f"{recipe.name}: made in {processor_s / 60:.1f} min of one processor")
    if recipe.earlier:
        _report(f"{recipe.name}: remove `earlier` from docs/results.toml")
    return True


if __name__ == "__main__":
    sys.exit(main())
