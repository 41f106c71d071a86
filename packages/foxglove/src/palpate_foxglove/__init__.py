"""Stream a sensor's data to Foxglove: the channels of a recording and live estimates.

`layout.json` is a Foxglove layout in the format of the app's own export.
"""

from pathlib import Path

#: The panel layout, to be imported in Foxglove.
LAYOUT = Path(__file__).with_name("layout.json")

__all__ = ["LAYOUT"]
