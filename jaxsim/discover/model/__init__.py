"""The statistical model: what a sensor is expected to say of simulated rays, and how likely what it said is."""
