"""Synthetic scenes for tests and benchmarks; needs scipy."""
