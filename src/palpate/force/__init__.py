"""Force from readings of the sheet and of the servo's current, with an interval."""
