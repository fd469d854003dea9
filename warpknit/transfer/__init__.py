"""Transfer of fields between meshes of one knit, the same for every kind of model: from smaller meshes and from a coarse grid.

A field has a value at each node or body of a panel (mesh/panel.py). Responses of one repeat correct it for local strain.
"""
