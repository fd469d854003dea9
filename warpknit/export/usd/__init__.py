"""A run as a USD stage for Blender, usdview and Omniverse; docs/scenes.md describes its attributes.

    scene.usda                 the stage: units, time codes, camera, lights, materials, levels of detail, the list of frames
    wires.topology.usdc        what does not move, and the pose of the first frame
    wires.manifest.usda        which attributes move
    frames/wires.######.usdc   one frame each: /Full, /K8, /Contacts and /Surface, payloads and value clips of a level of detail

    /World/Panel               variantSet lod: full, k8, surface
      /Tile_ii_jj              whole wires under a double translate, so that float32 points lie near zero
        Wires                  BasisCurves, linear; a closed wire ends with its first node one period on
        Contacts               Points, one a contact body; widths of a marker that reaches both wires
        ContactsElsewhere      Points, one an active contact between stitches
      /Surface                 Mesh, a face a repeat

Lengths are in mm, everything else in SI. A frame is on the disk before the stage names it, and every file is written aside and
renamed, so a killed run leaves a stage with the frames it had finished. `active` and `activePairs` are integers because USD
interpolates floats between frames and holds integers. Where a frame is left out the one before it stands still.
"""
