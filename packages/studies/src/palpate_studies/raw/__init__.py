"""Convert clones of public repositories into the tables of the studies."""
