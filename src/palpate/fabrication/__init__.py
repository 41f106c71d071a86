"""Cut patterns of the sensor: shapes, reasons for refusal, and files for a vinyl cutter."""
