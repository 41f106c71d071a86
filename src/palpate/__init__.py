"""palpate: examine produce by touch.

Settled values: `predict_settled` predicts from the first seconds of a hold. Force: `fit_force` fits
a sensor to known loads. Grasps: `open_rig` opens a rig, whose `grasp` holds an object and returns
force, size and stiffness. Each measured quantity is a `Measurement` with an interval.

The names are those of `__init__.pyi`, imported on first use, so that ``import palpate`` is fast.
"""

from __future__ import annotations

import importlib
import os
from functools import cache
from typing import Any

from palpate.version import __version__ as __version__


@cache
def _places() -> dict[str, str]:
    """Return public name -> module, from the stub that type checkers read."""
    with open(os.path.join(__path__[0], "__init__.pyi"), encoding="utf-8") as stub:
        rows = [line.split() for line in stub if line.startswith("from palpate")]
    return {name: module for _, module, _, name, *_ in rows}


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return sorted(_places().keys() - {"__version__"})
    # Python asks a package for its submodules and many private names.
    if name.startswith("_") or name not in _places():
        raise AttributeError(f"module 'palpate' has no attribute {name!r}")
    found = getattr(importlib.import_module(_places()[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(_places())
