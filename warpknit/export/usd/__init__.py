"""A run as a USD stage for Blender, usdview and Omniverse.

    scene.usda                 the stage: units, time codes, camera, lights, materials, levels of detail, the list of frames
    wires.topology.usdc        what does not move: curve counts, widths, names; and the pose of the first frame
    wires.manifest.usda        which attributes move
    frames/wires.######.usdc   one frame each, with /Full, /K8, /Contacts and /Surface; payloads and value clips of a
                               variant join those that it shows

    /World/Panel               variantSet lod: full; k8, at most every eighth node of a wire; surface, a sheet of repeats
      /Tile_ii_jj              whole wires under a double translate, so that float32 points lie near zero: column ii along
                               the weft, band jj along the warp
        Wires     BasisCurves, linear: the points are the nodes; a closed wire ends with its first node one period on.
                  primvars:warpknit:wireId (uniform), :stress (vertex) [Pa]; at k8 the largest around the point
        Contacts  Points, one a contact body; widths of a marker that reaches both wires.
                  primvars:warpknit:active (both pairs closed: 0 or 1), :activePairs (0, 1 or 2),
                  :normalForceA, :normalForceB, :normalForce (what passes from wire to wire: the smaller one) [N],
                  :wireA, :wireB
      /Surface    Mesh. primvars:warpknit:stress (largest) [Pa], :activeShare [%], :pairs, all uniform

A mesh of several tiles has its wires and contacts under the purpose `render`, and Surface under `proxy`, so that a program
can show something before it has read the wires. A mesh of one tile shows its wires under any purpose.

Lengths are in mm, everything else in SI. A time code is the index of a frame. A frame is on the disk before the stage
names it, and every file is written aside and renamed, so a killed run leaves a stage with the frames it had finished.
`active` and `activePairs` are integers because USD interpolates floats between frames and holds integers. Where a frame
is left out the one before it stands still.
"""
