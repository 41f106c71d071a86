"""Array functions: counts to ohm, relative change, events and hold windows."""
