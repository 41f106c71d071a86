"""Size, stiffness, firmness and damage limit of a held object, each with an interval."""
