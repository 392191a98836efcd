"""What changed in a fleet of axes over time, when and why: statistics over the stored results of many recordings.

Pure functions of arrays, but for `read`, which opens the Parquet data set.
"""
