"""Research beside the product: other methods, the paper's tables, the benchmark. Nothing that ships imports it."""
