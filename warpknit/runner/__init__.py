"""A run in its directory: records, checkpoints, summary and tables."""
