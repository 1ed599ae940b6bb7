"""Benchmark of the reported covariances against true errors."""
