"""A fleet: many recordings found, assigned to axes, identified and diagnosed on Dask, and kept as a Parquet data set."""
