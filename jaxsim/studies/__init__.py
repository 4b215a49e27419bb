"""The paper's studies: which inputs count (ablation), and Real2Sim2Real, with their tables and pages."""
