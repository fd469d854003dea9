"""Wires from elsewhere: centre lines that others made, from USD, BCC, .pyp, CSV and NPZ files.

A file becomes curves of cubic pieces (`usd`, `pyp`, `file_curves`, by `bases`), these become nodes at equal arc length,
and these are `Wires`; `read` is the way in, `overlaps` says where they touch as they come.
"""
