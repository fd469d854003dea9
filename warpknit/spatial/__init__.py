"""The spatial model: wires as rods in three dimensions, with twist and real contact between round wires.

rods.py        wires as discrete elastic rods, on the host
rod_arrays.py  rods and their state on the device
rod_step.py    one time step
rest_curve.py  the curve between the nodes on which wires touch
step_bound.py  the largest stable step, and fictitious masses for a unit step

    stepper = RodStepper(rods_of(section, points))       # time steps of wires from any source
    contact = WireContact(stepper, stiffness)            # adds the forces between them
    relaxation = RodRelaxation(stepper)                  # for equilibria: fictitious masses, damping, multipliers
"""
