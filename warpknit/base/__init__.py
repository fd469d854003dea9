"""Base of all rooms: files written whole, text, child processes, the curve between nodes."""
