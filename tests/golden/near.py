"""Comparison with kept figures."""

from __future__ import annotations

from typing import Any

import pytest


def near(kept: Any) -> Any:
    """Return kept figures to compare with: numbers to the digits that are kept."""
    if isinstance(kept, dict):
        return {name: near(value) for name, value in kept.items()}
    if isinstance(kept, list):
        return [near(value) for value in kept]
    return pytest.approx(kept, rel=2e-3, abs=1e-3) if isinstance(kept, float) else kept
