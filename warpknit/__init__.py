"""warpknit: explicit dynamics of knitted wire mesh."""

__version__ = "0.1.0"
