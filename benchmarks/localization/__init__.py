"""Localization by several methods on the same matches."""
