"""A run's folder: config.json, checkpoints/, metrics.jsonl, figures/, card.md; .lock while it is trained."""
