"""Benchmarks: speed/, studies/, blind/ (hidden worlds)."""
