"""How studies are made fair: parts that stay apart, paired differences, methods of outsiders."""
