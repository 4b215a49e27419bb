"""A run's folder: config.json, frames.json, checkpoints/, metrics.jsonl, figures/, card.md; .lock while it is trained.

run, kinds     starting, resuming and loading one; the table of what can be trained
frames         frames.json: which frames it learned from, by name
metrics_log    metrics.jsonl, and the trackers that are told the same
"""
