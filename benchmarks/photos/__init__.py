"""Queries that are only photos."""
