"""Seconds per query."""
