"""The paper's first table: what each kind of input is worth to the intensity network."""
