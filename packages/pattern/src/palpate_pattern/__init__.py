"""Cut patterns of the sensor: shapes, design checks, and files for a vinyl cutter."""
