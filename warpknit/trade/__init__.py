"""Speed against accuracy on one scene, measured: `warpknit trade`.

parameters.py  numerical parameters, their values, and the points of a study
point.py       one point: a run without files, its results and its cost
trade_table.py trade.csv: one row a point, with its errors against the reference
extrapolation.py order of convergence and error of the reference by Richardson extrapolation
pareto.py      the Pareto front of error against cost
probe_run.py   small meshes that estimate the error of a setting
error_estimate.py `warpknit run --error`
study.py       all points into a directory, interrupted and resumed
"""
