"""Work over many sessions, on the cores there are or on Dask."""
