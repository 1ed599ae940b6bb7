"""Finds similar database images by global descriptors, and writes them as pairs."""
