"""Show: the gap on judge scenes, which nothing was fitted to."""
