"""Export recorded grasps as a LeRobot data set (format v3.0), without LeRobot installed."""
