"""Cut patterns of the sensor: shapes, what makes them impossible, and files for a vinyl cutter."""
