"""What every room may use: files that are written whole, text, child processes, the curve between nodes."""
