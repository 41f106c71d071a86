"""How good predictions of settled values are: on many holds, scored, and decided in time."""
