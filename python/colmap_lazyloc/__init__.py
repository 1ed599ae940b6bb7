"""Poses, file formats and commands around `colmap lazy_localizer`; scripts, tests and benchmarks are built on it.

The package imports none of its modules by itself, because each module needs other third-party packages.
"""

__version__ = "0.1.0"
