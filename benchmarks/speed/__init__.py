"""Hot paths against their strongest peers."""
