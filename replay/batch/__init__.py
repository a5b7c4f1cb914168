"""Many recordings computed anew at once, over Dask."""
