"""Design report of a mesh: `warpknit report`.

    map -> tension-strain curves, strains at a tension -> material card, openings, electrical resistance -> page

The mesh is endless cloth: one periodic repeat. Axes: 1 = weft (x), 2 = warp (y). SI units.
"""
