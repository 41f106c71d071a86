"""The same runner in a browser: a process with the devices, a session of rules, a thin page."""
