"""Items of produce: records of grasps, and the judgements that follow from them."""
