"""Numbers formatted for people."""

from __future__ import annotations

ZERO_CELSIUS = 273.15  # [K]
PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"))


def engineering(value: float, unit: str) -> str:
    """`value` with three digits and a prefix: 1.48e8, "Pa" as 148 MPa."""
    size = abs(float(f"{value:.3g}"))  # 999.8 of one prefix is 1 of the next
    scale, prefix = next(((scale, prefix) for scale, prefix in PREFIXES if size >= scale), (1.0, ""))
    return f"{value / scale:.3g} {prefix}{unit}"


def celsius(temperature: float) -> str:
    """A temperature [K] in degrees Celsius: 83.15 as -190 degC."""
    return f"{temperature - ZERO_CELSIUS:.4g} degC"


def percent(share: float) -> str:
    """A share in percent with one digit after the point: 0.0966 as 9.7 %."""
    return f"{100.0 * share:.1f} %"


def memory(count: int) -> str:
    """Bytes with a binary prefix."""
    return f"{count / 2**30:.3g} GiB" if count >= 2**30 else f"{count / 2**20:.0f} MiB"


def duration(seconds: float) -> str:
    """A time with two digits and a suitable unit."""
    for unit, length in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.2g} {unit}"
    return f"{seconds:.2g} s"


def rounded(count: int) -> int:
    """A count rounded to two digits."""
    return int(float(f"{count:.2g}"))
