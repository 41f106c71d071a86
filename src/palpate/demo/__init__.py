"""Files to try palpate on without a sensor; all of it simulated, and labelled so."""
