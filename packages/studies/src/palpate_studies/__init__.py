"""Studies: one file per claim of the paper or of palpate."""
