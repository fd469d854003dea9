"""What the models of wires have in common: protocols of the engine, solver constants, and transfer of fields between meshes.

A field has a value at each node or body of a panel (mesh/panel.py). Responses of one repeat correct it for local strain.
"""
