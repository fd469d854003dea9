"""Contact maps: many loads of one repeat, stepped side by side."""
