"""The second generator: cases that no estimator was written for, for `--second` of a study."""
