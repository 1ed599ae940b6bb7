"""Benchmarks of the time per query."""
