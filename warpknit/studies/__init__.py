"""Many runs of one scene: contact map (`warpknit map`), speed against accuracy (`trade`, `run --error`), report (`report`).

    map -> tension-strain curves, strains at a tension -> material card, openings, electrical resistance -> page of the report

A report is of endless cloth: one periodic repeat. Axes: 1 = weft (x), 2 = warp (y). SI units.
"""
