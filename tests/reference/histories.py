"""Rows of a made-up history, as `history.csv` holds them."""


def history(count: int, *, weft: float = 0.1, warp: float = 0.1, cold: int = 0) -> list[dict[str, object]]:
    rows = []
    for index in range(count + cold):
        factor = min(1.0, (index + 1) / count)
        rows.append(
            {
                "index": index,
                "stage": "load" if index < count else "cold",
                "load_factor": factor if index < count else (index + 1 - count) / cold,
                "strain_weft": factor * weft,
                "strain_warp": factor * warp,
                "shear": 0.0,
                "temperature_K": 293.15 if index < count else 83.15,
                "active_percent": 67.0 * factor,
                "tension_weft_N_per_m": 2.0 * factor**2,
                "tension_warp_N_per_m": 1.9 * factor**2,
                "energy_stretch_J": 1e-9 * factor**2,
                "energy_bend_J": 1e-6 * factor**2,
                "energy_contact_J": 0.0,
                "energy_kinetic_J": 1e-30,
                "residual": 1e-3,
            }
        )
    return rows
