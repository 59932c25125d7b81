"""Executors: this process, several processes, or a Dask cluster."""
