"""The runner in a browser: a device process, a session with rules, a thin page."""
