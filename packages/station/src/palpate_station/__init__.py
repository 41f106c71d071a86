"""Items of produce: records of grasps, and judgements from the records."""
