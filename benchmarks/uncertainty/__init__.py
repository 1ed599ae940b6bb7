"""Reported covariances against true errors."""
