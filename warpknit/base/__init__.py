"""Base of all rooms: files written whole, text, errors, child processes, the curve between nodes."""
