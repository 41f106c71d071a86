"""Arrays in, arrays out: counts to ohm, relative change, events and hold windows."""
