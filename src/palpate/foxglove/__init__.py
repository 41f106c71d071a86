"""A sensor's data for every Foxglove that connects: the channels of a recording, and more.

`layout.json` is the arrangement of panels that a user imports there. Its form is that of the app's
own export.
"""

from pathlib import Path

#: The layout that a user imports in Foxglove.
LAYOUT = Path(__file__).with_name("layout.json")

__all__ = ["LAYOUT"]
