"""Parts of benchmarks/blind/effects.py: which cases, one case, what others would answer, tables, pictures."""
