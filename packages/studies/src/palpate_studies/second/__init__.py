"""The second generator of `--second`, for which no estimator was designed."""
