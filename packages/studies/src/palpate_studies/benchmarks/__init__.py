"""Benchmarks of `palpate bench`; every figure is a ratio to a named peer."""
