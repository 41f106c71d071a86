"""The steps of `palpate archive`, a verb through an entry point."""

from __future__ import annotations

_ADD, _WORK = "palpate_archive.add_command", "palpate_archive.work_commands"

#: Step -> (where it is, what it does).
STEPS = {
    "add": (f"{_ADD}:add", "Put recordings and a store into it; what is there stays"),
    "compact": (f"{_ADD}:compact", "Join a day's small files into few"),
    "settle": (f"{_WORK}:settle", "Predict the settled value of every hold again"),
    "recalibrate": (f"{_WORK}:recalibrate", "Read the force of every frame again"),
    "judge": (f"{_WORK}:judge", "Decide again which bin each grasp alone would have chosen"),
}
