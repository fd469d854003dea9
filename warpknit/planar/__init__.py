"""The planar model: wires in a plane, hooked by free contact bodies."""
