"""Localizes the shards of a run on a Dask cluster."""
