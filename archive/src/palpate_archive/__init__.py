"""Grasps, holds and frames of many stations as partitioned Parquet, with analysis of all."""
