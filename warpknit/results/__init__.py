"""Results of a run: recorded frames, and the `Run` of a finished directory."""
