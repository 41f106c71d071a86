"""The commands of `palpate archive`, registered through an entry point."""

from __future__ import annotations

_COMMANDS = "palpate_archive.commands"
#: Command -> (location, description).
STEPS = {
    "add": (f"{_COMMANDS}:add", "Add recordings and the grasps of a store"),
    "compact": (f"{_COMMANDS}:compact", "Join the small files of each day"),
    "settle": (f"{_COMMANDS}:settle", "Predict the settled value of every hold"),
    "recalibrate": (f"{_COMMANDS}:recalibrate", "Estimate the force of every frame"),
    "compare": (f"{_COMMANDS}:compare", "Compare the results of two versions"),
    "forget": (f"{_COMMANDS}:forget", "Delete stations, items or days"),
}
