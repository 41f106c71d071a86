"""From clones of public repositories to the tables that studies read."""
