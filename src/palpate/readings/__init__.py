"""Recordings of anybody's sensor: tables of readings against time, and the holds in them.

Between `palpate.signal`, whose divider it uses, and `palpate.settling`, which predicts from holds
wherever they come from. Not part of `palpate.recording`, which knows frames, grippers and MCAP.
"""

from palpate.readings.holds import CutColumn, cut_columns, cut_holds, why_none
from palpate.readings.read import Readings, read_recording, read_recordings

__all__ = [
    "CutColumn",
    "Readings",
    "cut_columns",
    "cut_holds",
    "read_recording",
    "read_recordings",
    "why_none",
]
