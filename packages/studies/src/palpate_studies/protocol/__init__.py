"""Evaluation protocol of the studies: separate training and test sets, paired differences."""
