"""Arrays in, arrays out: counts to ohm, relative change, events and the windows of a hold."""
