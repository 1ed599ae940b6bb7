"""Reads poses of cameras from files of other programs."""
