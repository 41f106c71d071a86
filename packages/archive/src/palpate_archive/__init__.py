"""Archive of grasps, holds and frames of many stations as partitioned Parquet."""
