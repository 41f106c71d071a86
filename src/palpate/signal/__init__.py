"""Array functions: counts to ohms, relative change, events and hold windows."""
