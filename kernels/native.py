"""What the native functions share: C++ that Warp compiles as it stands."""


def constants(**values: float) -> str:
    """C++ declarations of constants, to stand before the text of a native function."""
    whole = ", ".join(f"{name} = {int(value)}" for name, value in values.items() if float(value) == int(value))
    parts = [f"    enum {{ {whole} }};\n"] if whole else []
    return "".join(parts + [f"    const double {n} = {float(v)!r};\n" for n, v in values.items() if float(v) != int(v)])
