"""Benchmarks of `palpate bench`, one per file; every figure is a ratio to a named peer."""
