"""Common part of the native functions: C++ that Warp compiles, for both precisions.

Constants of kernels/control.py and columns of the partial sums are declared under their names.
"""

from . import control as c


def constants(**values: float) -> str:
    """C++ declarations of constants, to stand before the text of a native function."""
    whole = ", ".join(f"{name} = {int(value)}" for name, value in values.items() if float(value) == int(value))
    parts = [f"    enum {{ {whole} }};\n"] if whole else []
    return "".join(parts + [f"    const double {n} = {float(v)!r};\n" for n, v in values.items() if float(v) != int(v)])


STEERING = constants(
    VELOCITY_FACTOR=c.VELOCITY_FACTOR,
    FORCE_FACTOR=c.FORCE_FACTOR,
    TIME_STEP=c.TIME_STEP,
    GRADIENT=c.GRADIENT,
    LENGTH_FACTOR=c.LENGTH_FACTOR,
    LOOK_AHEAD=c.LOOK_AHEAD,
    CONTACT_STIFFNESS=c.CONTACT_STIFFNESS,
    BOW_MOMENT=c.BOW_MOMENT,
    BODY_INVERSE_MASS=c.BODY_INVERSE_MASS,
    TRAVEL=c.TRAVEL,
    SLOPE_FACTOR=c.SLOPE_FACTOR,
    KINETIC_PART=c.KINETIC_PART,
    SPEED_PART=c.SPEED_PART,
    STRONGEST_PART=c.STRONGEST_PART,
    FORCE_PART=c.FORCE_PART,
    PARTIAL_COUNT=c.PARTIAL_COUNT,
)
