"""Common parts of the models: protocols of the engine, solver constants, transfer of fields.

A field has a value at each node or body of a panel (mesh/panel.py). Responses of one repeat correct it for local strain.
"""
