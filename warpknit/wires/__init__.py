"""Wires from elsewhere: centre lines that others made, from USD, BCC, .pyp, CSV and NPZ files.

A file becomes curves of cubic pieces (`usd`, `bcc`, `pyp`, `table`, `npz`, by `bases`), these become nodes at equal arc length
(`arc_length`), and these are `Wires`; `read` is the way in, `overlaps` says where they touch as they come.
"""
