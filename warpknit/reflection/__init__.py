"""Reflection of a plane wave by an endless mesh of thin round wires. Contacts have an impedance.

A recorded equilibrium (`repeat`) becomes branches of wire and contacts (`impedance`). A mixed-potential integral equation,
interpolated over a band, gives their currents (`green`, `currents`), and the currents give the waves that leave the mesh
(`waves`). `study` solves the states of a directory, and `table` has rows and findings.
"""
