"""Grasps, holds and frames of many stations as partitioned Parquet, and work on all of it."""
