"""The mesh at rest: the table of one repeat, the panel of its copies, cut and clamped; or two hooked wires."""
