"""Array functions: counts to ohms, crosstalk, relative change, events and hold windows."""
