"""Fixtures: the folder of real recordings, and studies run through the command line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from tests.commands import Command
from tests.fixtures import real_data

__all__ = ["document", "real_data", "refusal"]


@pytest.fixture
def document(palpate: Command) -> Callable[..., Any]:
    """Return a function that runs `palpate study` with arguments and returns its JSON."""
    return lambda *words: palpate("study", *words, "--json").document


@pytest.fixture
def refusal(palpate: Command) -> Callable[..., str]:
    """Return a function that runs `palpate study` and returns its one-line refusal."""
    return lambda *words: palpate.refused("study", *words).strip()
