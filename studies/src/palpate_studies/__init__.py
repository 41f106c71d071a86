"""One file per claim: of the paper, and of ours."""
