"""Parts of benchmarks/hidden_effects.py: which cases, one case, what others would answer, tables, pictures."""
