"""Poses, files and programs around `colmap lazy_localizer`; scripts, tests and benchmarks are built on it.

Importing the package imports nothing else, so that each module asks only for the packages that it uses.
"""

__version__ = "0.1.0"
