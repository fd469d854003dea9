"""The engine: load levels, convergence, and the loop over the stages."""
