"""What ours has to beat: one rival a file, each in its strongest plain form."""
