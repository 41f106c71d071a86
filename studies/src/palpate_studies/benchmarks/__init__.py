"""What `palpate bench` measures: one file each, every figure a ratio to a named peer."""
