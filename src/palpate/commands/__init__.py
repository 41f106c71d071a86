"""One file per verb of the command line; heavy imports wait until the verb runs."""
