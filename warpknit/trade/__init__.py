"""Speed against accuracy on one scene, measured: `warpknit trade`.

knobs.py       what can be turned, and the points that are tried
point.py       one point: a run without files, what it found and what it cost
table.py       trade.csv: a row a point, with its errors against the reference
convergence.py order of convergence and error of the reference by Richardson extrapolation
front.py       which points nothing beats, and what each knob buys alone
study.py       all points into a directory, interrupted and resumed
"""
