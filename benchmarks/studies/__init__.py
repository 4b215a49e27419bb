"""What choices are worth: targets, depths, intensity."""
