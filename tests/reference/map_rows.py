"""Rows of a contact map."""

from warpknit.studies.contact_map import MapRow


def row(weft: float, warp: float, tension: tuple[float, float] | tuple[None, None]) -> MapRow:
    """The row of a pair of strains: its tensions [N/m], and a stress of 1 GPa times the warp strain."""
    return MapRow(
        strain_weft=weft,
        strain_warp=warp,
        active_percent=50.0,
        tension_weft_N_per_m=tension[0],
        tension_warp_N_per_m=tension[1],
        stress_max_Pa=1e9 * warp,
        stop_reason="steady",
    )
