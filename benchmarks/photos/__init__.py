"""Benchmarks of queries that are photos without features or matches in the database."""
