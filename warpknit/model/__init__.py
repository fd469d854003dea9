"""What a run computes with: everything that does not move, and everything that does."""
