"""Compares poses with photos, and finds out what is wrong with those that do not fit."""
