"""What a grasp says about an item of produce."""
