"""A run in the browser: wires and contacts of its records in space."""
