"""Benchmark of localization by several methods on the same matches."""
