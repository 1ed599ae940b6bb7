"""The benchmarks of colmap_lazyloc: `python -m benchmarks` says which there are."""
