"""The runner in a browser: a device process, a session with the rules, a thin page."""
