"""Running and recorded sensors in the Rerun viewer."""
