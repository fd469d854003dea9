"""Contact maps: equilibria of one mesh under many loads."""
