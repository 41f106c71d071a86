"""All benchmarks, one after the other: what `palpate bench` runs without a name."""

from __future__ import annotations

from palpate_studies.benchmarks.running import ALL, command_of

command = command_of(ALL)
