"""Chain notation to clasps: the geometry of one repeat of endless warp-knitted cloth.  NumPy and SciPy only.

chain -> lapping -> loops -> centreline -> crossings -> clasps -> openings -> cloth
"""
