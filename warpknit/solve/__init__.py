"""How a state is found: the time step, what is decided between steps, and the loop over the stages."""
