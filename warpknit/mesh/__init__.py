"""The mesh at rest: one repeat as a table, its copies as a panel, cut and held; or two hooked wires."""
