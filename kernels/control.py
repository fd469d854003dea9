"""Control array of a time step on the device; its update after each step.

Every step, for wires and bodies alike, reads

    v' = VELOCITY_FACTOR v + FORCE_FACTOR f / m          u' = u + TIME_STEP (v' + LOOK_AHEAD (v' - v))

with the factors of central differences under mass-proportional damping c,

    VELOCITY_FACTOR = (1 - c dt/2)/(1 + c dt/2)          FORCE_FACTOR = dt/(1 + c dt/2)

so one set of kernels serves both drives: `ramp` has real (or scaled) masses and a given c, `relax` has fictitious masses
that are stable at unit step and a c near the critical damping of the slowest active mode (kernels/rayleigh.py).

With LOOK_AHEAD = g the stored u is extrapolated by g steps, x + g dt v, so that forces are evaluated ahead of time. A mode of
frequency w then loses g (w dt)^2/2 of its amplitude a step in addition to c dt/2: stiff modes decay within tens of steps, slow
modes are not affected. The step is stable up to w dt = 2/sqrt(1 + 2 g). A ramp has g = 0.

The boundary moves by the deformation gradient F, which follows a ramp from FROM to TO over RAMP_STEPS steps, smooth or even;
over more where it lags. A displacement above STEP_LIMIT in a step freezes the state (STATUS_DIVERGED), and so does a travel
above TRAVEL_LIMIT since the last neighbour search (STATUS_STALE): later steps of the graph then change nothing.

In a direction given by tension the strain of the boundary is an unknown of the relaxation, with a mass and the same damping (the
cell of Parrinello and Rahman 1981, J. Appl. Phys. 52, 7182). With F = R^T U, U upper triangular, and P the nominal stress of the
step, in the frame in which the boundary is strained by U,

    T = diag(R P U^T)/det U                                     true tensions [N/m]
    v' = ((1 - c/2) v + (T* - T) U_other/M)/(1 + c/2)           strain a step, at most STRAIN_LIMIT
    U_own' = U_own + v'

The wanted tensions T* follow the ramp of the load. Where the mesh has a history, strains stay within STRAIN_RANGE of their origin
until the next equilibrium. While a direction is at that limit, the strain of the other one rests.
"""

import warp as wp

# what a step reads
VELOCITY_FACTOR = wp.constant(0)
FORCE_FACTOR = wp.constant(1)
TIME_STEP = wp.constant(2)
GRADIENT = wp.constant(3)  # 4 entries: xx, xy, yx, yy, then the length factor 1 + alpha (T - T0) of the wires
LENGTH_FACTOR = wp.constant(7)
LOOK_AHEAD = wp.constant(8)  # steps of extrapolation, in relax
CONTACT_STIFFNESS = wp.constant(9)  # [N/m]
BOW_MOMENT = wp.constant(10)  # 2 BOW (bend.py) where multipliers keep the length of arcs, else 0
BODY_INVERSE_MASS = wp.constant(11)  # [1/kg]
# the load ramp
FROM = wp.constant(12)  # 5 entries: GRADIENT and LENGTH_FACTOR at the start of the ramp
TO = wp.constant(17)  # 5 entries: at its end
RAMP_STEP = wp.constant(22)
RAMP_STEPS = wp.constant(23)
# drive
DRIVE = wp.constant(24)  # 0 relax, 1 ramp
DAMPING = wp.constant(25)  # [1/s]
DEAD_LOAD = wp.constant(26)  # [N] spatial: rms of the dead loads on the nodes of the mesh, 0 without any
LOAD_RESTS = wp.constant(27)  # 1 where the load did not move after the last step
FRAMES_AHEAD = wp.constant(28)  # spatial: 1 if the last step computed the frames of this one
SPEED_LIMIT = wp.constant(29)  # [m] largest displacement a step in relax; speeds are scaled down to it
# checks
STEP_LIMIT = wp.constant(30)  # [m] a larger displacement in a step is a divergence
TRAVEL = wp.constant(31)  # [m] bound on any displacement since the last neighbour search
TRAVEL_LIMIT = wp.constant(32)
STATUS = wp.constant(33)
STEP = wp.constant(34)  # steps taken
# sums over the step just taken
KINETIC_TWICE = wp.constant(37)  # [J] sum m v^2
SPEED_MAX = wp.constant(38)  # [m/s]
FORCE_MAX = wp.constant(39)  # [N]
FORCE_SQUARE = wp.constant(40)  # [N2]
DISSIPATED = wp.constant(41)  # [J] dissipated by mass-proportional damping
RAMP_SHARE = wp.constant(42)  # share of the clamp displacement of the ramp, 0 .. 1
MULTIPLIER_RATE = wp.constant(43)  # [-] share of the constraint error in an update of the multipliers (multiplier_update.py)
SLOPE_FACTOR = wp.constant(44)  # [1/(N m2)] SLOPE_SHARE/EI (bend.py)
EVEN_RAMP = wp.constant(45)  # 1: equal load increments, as for an interval of a longer ramp
LOAD_STEP = wp.constant(46)  # 4 entries: increment of GRADIENT in the last step
EVALUATED_GAP = wp.constant(50)  # [m] spatial: up to here an evaluation without a step finds closest points
NEAR_GAP = wp.constant(51)  # [m] spatial: up to here a pair of segments is listed as near
PAIR_REACH = wp.constant(52)  # [m] of travel that a unit strain of the load adds, half of the relative motion of what may touch
EXTRAPOLATION = wp.constant(54)  # [-] predicted change of a level over the previous level's (multiplier_update.py)
# of a convergence check of spatial wires (contact_checks.py)
PENALTY_FLOOR = wp.constant(55)  # [N/m] least penalty of a contact
MEAN_PUSH = wp.constant(56)  # [N] mean force of the contacts that push
IS_LOADING = wp.constant(57)  # 1 while a load is applied
STICKING = wp.constant(58)  # [N/m] tangential stiffness of contacts
STEP_TRAVEL = wp.constant(59)  # [m] spatial: the part of TRAVEL from steps of nodes
RAMP_LAG = wp.constant(60)  # of a step: by so much less RAMP_STEP moves on in each
# directions given by tension, weft and warp: 2 entries each
IS_DRIVEN = wp.constant(61)  # 1: the strain moves by what the tension lacks
TENSION_FROM = wp.constant(63)  # [N/m] wanted at the start of the ramp
TENSION_TO = wp.constant(65)  # [N/m] at its end
STRAIN_SPEED = wp.constant(67)  # strain of the last step
STRAIN_MASS = wp.constant(69)  # [N/m]
TENSION = wp.constant(71)  # [N/m] in the last step
STRAIN_LIMIT = wp.constant(73)  # largest strain of a step
CELL_AREA = wp.constant(74)  # [m2] of the mesh at rest
STRESS_UNIT = wp.constant(75)  # [N m] of a count of the stress of a step: whole numbers, whose sum is the same in any order
STRAIN_ORIGIN = wp.constant(76)  # 2 entries: strain at the last equilibrium
STRAIN_RANGE = wp.constant(78)  # largest change of a strain from one equilibrium to the next
AT_LIMIT = wp.constant(79)  # 2 entries: 1 where the strain has changed by that much
FRICTION = wp.constant(81)  # [-] spatial: coefficient
LAST_STEP = wp.constant(82)  # of one of many worlds, which waits from there on
# of the curve of a world (spatial/rest_curve.py): bounds of what a contact force does to nodes and sections
WEIGHT_SQUARE = wp.constant(83)
LEVER = wp.constant(84)  # [m]
CONTROL_COUNT = 85

NEARLY = wp.constant(wp.float64(1.0 - 1.0e-6))  # of a limit that counts as reached

STATUS_RUNNING = wp.constant(wp.float64(0.0))
STATUS_STALE = wp.constant(wp.float64(1.0))
STATUS_DIVERGED = wp.constant(wp.float64(2.0))
STATUS_EVALUATING = wp.constant(wp.float64(3.0))  # of rods: a step finds the forces of the state and moves nothing
STATUS_ACCEPTING = wp.constant(wp.float64(4.0))  # the same, and an increment of load ends (wire_contact_forces.py)
STATUS_WAITING = wp.constant(wp.float64(5.0))  # of one of many worlds: steps and evaluations of others leave it out

# columns of the partial sums, a row for every block of nodes and of bodies
KINETIC_PART = wp.constant(0)  # [J] sum m v^2
SPEED_PART = wp.constant(1)  # [m2/s2] largest v^2
STRONGEST_PART = wp.constant(2)  # [N2] largest f^2
FORCE_PART = wp.constant(3)  # [N2] sum f^2
STRESS_PART = wp.constant(4)  # counts of STRESS_UNIT, 4 entries: nominal stress times the rest area, xx, xy, yx, yy
PARTIAL_COUNT = 8
partial_sums = wp.types.vector(length=PARTIAL_COUNT, dtype=wp.float64)


@wp.func
def is_halted(control: wp.array(dtype=wp.float64)) -> bool:
    """Whether the remaining steps of a graph have nothing to do."""
    status = control[STATUS]
    return status == STATUS_STALE or status == STATUS_DIVERGED or status == STATUS_WAITING


@wp.func
def smooth_ramp(x: wp.float64) -> wp.float64:
    """x^3 (10 - 15 x + 6 x^2): speed and acceleration vanish at both ends."""
    return x * x * x * (wp.float64(10.0) + x * (wp.float64(6.0) * x - wp.float64(15.0)))


@wp.func
def is_driven(control: wp.array(dtype=wp.float64)) -> bool:
    """Whether the strain of a direction moves by what its tension lacks."""
    return control[IS_DRIVEN] != wp.float64(0.0) or control[IS_DRIVEN + 1] != wp.float64(0.0)


@wp.func
def strain_by_tension(control: wp.array(dtype=wp.float64), sums: partial_sums):
    """Move driven strains by one step, and the ramp with them; sums: of the last step."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    unit = control[STRESS_UNIT] / control[CELL_AREA]
    xx = unit * sums[STRESS_PART]
    xy = unit * sums[STRESS_PART + 1]
    yx = unit * sums[STRESS_PART + 2]
    yy = unit * sums[STRESS_PART + 3]
    weft = wp.sqrt(control[GRADIENT] * control[GRADIENT] + control[GRADIENT + 2] * control[GRADIENT + 2])
    cosine = control[GRADIENT] / weft
    sine = -control[GRADIENT + 2] / weft
    shear = cosine * control[GRADIENT + 1] - sine * control[GRADIENT + 3]
    warp = sine * control[GRADIENT + 1] + cosine * control[GRADIENT + 3]
    # rows of R P, and U = (weft, shear; 0, warp)
    control[TENSION] = ((cosine * xx - sine * yx) * weft + (cosine * xy - sine * yy) * shear) / (weft * warp)
    control[TENSION + 1] = (sine * xy + cosine * yy) / weft
    half = wp.float64(0.5) * control[DAMPING] * control[TIME_STEP]
    share = one
    if control[RAMP_STEP] < control[RAMP_STEPS]:
        share = control[RAMP_SHARE]
    limit = control[STRAIN_LIMIT] * (one - control[RAMP_LAG])
    weft_is_at_limit = control[AT_LIMIT] != zero
    warp_is_at_limit = control[AT_LIMIT + 1] != zero
    for a in range(2):
        if control[IS_DRIVEN + a] == zero:
            continue
        if (a == 0 and warp_is_at_limit and not weft_is_at_limit) or (a == 1 and weft_is_at_limit and not warp_is_at_limit):
            control[STRAIN_SPEED + a] = zero
            continue
        strain = wp.where(a == 0, weft, warp) - one - control[STRAIN_ORIGIN + a]
        wanted = control[TENSION_FROM + a] + share * (control[TENSION_TO + a] - control[TENSION_FROM + a])
        lacking = (wanted - control[TENSION + a]) * wp.where(a == 0, warp, weft)
        speed = wp.max(one - half, zero) * control[STRAIN_SPEED + a] + lacking / control[STRAIN_MASS + a]
        speed = wp.clamp(speed / (one + half), -limit, limit)
        moved = wp.clamp(strain + speed, -control[STRAIN_RANGE], control[STRAIN_RANGE])
        control[AT_LIMIT + a] = wp.where(wp.abs(moved) >= NEARLY * control[STRAIN_RANGE], one, zero)
        speed = moved - strain
        control[STRAIN_SPEED + a] = speed
        x = wp.where(a == 0, cosine, sine) * speed
        y = wp.where(a == 0, -sine, cosine) * speed
        for base in range(3):  # column a of F, FROM and TO
            k = wp.where(base == 0, GRADIENT, wp.where(base == 1, FROM, TO)) + a
            control[k] = control[k] + x
            control[k + 2] = control[k + 2] + y


@wp.func
def advance_load(control: wp.array(dtype=wp.float64), sums: partial_sums):
    """Move deformation gradient and length factor along the ramp, and driven strains."""
    for k in range(4):
        control[LOAD_STEP + k] = -control[GRADIENT + k]
    if is_driven(control):
        strain_by_tension(control, sums)
    if control[RAMP_STEP] < control[RAMP_STEPS]:
        control[RAMP_STEP] = wp.min(control[RAMP_STEP] + (wp.float64(1.0) - control[RAMP_LAG]), control[RAMP_STEPS])
        s = control[RAMP_STEP] / control[RAMP_STEPS]
        if control[EVEN_RAMP] == wp.float64(0.0):
            s = smooth_ramp(s)
        control[RAMP_SHARE] = s
        for k in range(5):
            control[GRADIENT + k] = control[FROM + k] + s * (control[TO + k] - control[FROM + k])
    for k in range(4):
        control[LOAD_STEP + k] = control[LOAD_STEP + k] + control[GRADIENT + k]


@wp.func
def is_at_rest(control: wp.array(dtype=wp.float64)) -> bool:
    """Whether the load neither moved after the last step nor moves after this one."""
    rests = control[LOAD_RESTS] == wp.float64(1.0) and control[RAMP_STEP] >= control[RAMP_STEPS]
    return rests and not is_driven(control)


@wp.func
def set_factors(control: wp.array(dtype=wp.float64)):
    """Central differences with mass-proportional damping; in relax, speeds are scaled down to SPEED_LIMIT."""
    half = wp.float64(0.5) * control[DAMPING] * control[TIME_STEP]
    a = (wp.float64(1.0) - half) / (wp.float64(1.0) + half)
    move = control[SPEED_MAX] * control[TIME_STEP]
    if control[DRIVE] == wp.float64(0.0) and move > control[SPEED_LIMIT]:
        a = a * control[SPEED_LIMIT] / move
    control[VELOCITY_FACTOR] = a
    control[FORCE_FACTOR] = control[TIME_STEP] / (wp.float64(1.0) + half)


@wp.func
def add_rows(sums: partial_sums, partial: wp.array2d(dtype=wp.float64), begin: int, end: int, step: int, with_stress: bool):
    """Add rows in their order; of the two largest squares take the larger. with_stress: also what moves driven strains."""
    for b in range(begin, end, step):
        sums[KINETIC_PART] += partial[b, KINETIC_PART]
        sums[SPEED_PART] = wp.max(sums[SPEED_PART], partial[b, SPEED_PART])
        sums[STRONGEST_PART] = wp.max(sums[STRONGEST_PART], partial[b, STRONGEST_PART])
        sums[FORCE_PART] += partial[b, FORCE_PART]
    if with_stress:
        for b in range(begin, end, step):
            for k in range(int(STRESS_PART), PARTIAL_COUNT):
                sums[k] += partial[b, k]
    return sums


@wp.func
def all_rows(wire_partial: wp.array2d(dtype=wp.float64), body_partial: wp.array2d(dtype=wp.float64), with_stress: bool):
    """The sums of the rows of wires, then of bodies."""
    sums = add_rows(partial_sums(), wire_partial, 0, wire_partial.shape[0], 1, with_stress)
    return add_rows(sums, body_partial, 0, body_partial.shape[0], 1, with_stress)


@wp.func
def set_row(partial: wp.array2d(dtype=wp.float64), row: int, sums: partial_sums):
    for k in range(PARTIAL_COUNT):
        partial[row, k] = sums[k]


@wp.kernel
def sum_partials(
    # in
    wire_partial: wp.array2d(dtype=wp.float64),
    body_partial: wp.array2d(dtype=wp.float64),
    # out: one row
    row: wp.array2d(dtype=wp.float64),
):
    """The partial sums of a strip as one row."""
    set_row(row, 0, all_rows(wire_partial, body_partial, True))


@wp.func
def renew_control(sums: partial_sums, control: wp.array(dtype=wp.float64)):
    """From the sums over the step just taken: check limits, set the next factors, move the load."""
    kinetic = sums[KINETIC_PART]
    finite = wp.isfinite(kinetic) and wp.isfinite(sums[FORCE_PART])
    control[KINETIC_TWICE] = kinetic
    control[SPEED_MAX] = wp.sqrt(sums[SPEED_PART])
    control[FORCE_MAX] = wp.sqrt(sums[STRONGEST_PART])
    control[FORCE_SQUARE] = sums[FORCE_PART]
    control[STEP] = control[STEP] + wp.float64(1.0)
    control[DISSIPATED] = control[DISSIPATED] + control[DAMPING] * control[TIME_STEP] * kinetic
    move = control[SPEED_MAX] * control[TIME_STEP]
    control[TRAVEL] = control[TRAVEL] + move
    control[STEP_TRAVEL] = control[STEP_TRAVEL] + move
    if not finite or move > control[STEP_LIMIT]:
        control[STATUS] = STATUS_DIVERGED
    else:
        set_factors(control)
        control[FRAMES_AHEAD] = wp.where(is_at_rest(control), wp.float64(1.0), wp.float64(0.0))
        control[LOAD_RESTS] = wp.where(control[RAMP_STEP] >= control[RAMP_STEPS], wp.float64(1.0), wp.float64(0.0))
        factor = control[LENGTH_FACTOR]
        advance_load(control, sums)
        strain = wp.abs(control[LENGTH_FACTOR] - factor)
        for k in range(4):
            strain += wp.abs(control[LOAD_STEP + k])
        control[TRAVEL] = control[TRAVEL] + control[PAIR_REACH] * strain
        if control[TRAVEL] > control[TRAVEL_LIMIT]:
            control[STATUS] = STATUS_STALE


@wp.kernel
def update_control(
    # in
    wire_partial: wp.array2d(dtype=wp.float64),
    body_partial: wp.array2d(dtype=wp.float64),
    # in and out
    control: wp.array(dtype=wp.float64),
):
    """One thread, after each step."""
    if control[STATUS] != STATUS_RUNNING:
        return
    renew_control(all_rows(wire_partial, body_partial, is_driven(control)), control)


@wp.kernel
def update_controls(
    # in
    first_world: int,
    world_rows: int,
    wire_partial: wp.array2d(dtype=wp.float64),
    stress_rows: int,
    # in and out: counts of the stress, rows of each world side by side; set to zero
    stress_count: wp.array2d(dtype=wp.int64),
    control: wp.array2d(dtype=wp.float64),
):
    """Update the control rows of worlds after each step, one thread a world. Its rows of partial sums stand side by side; it
    waits after its last step.
    """
    world = first_world + wp.tid()
    if control[world, STATUS] == STATUS_RUNNING:
        sums = add_rows(partial_sums(), wire_partial, world * world_rows, (world + 1) * world_rows, 1, False)
        for row in range(world * stress_rows, (world + 1) * stress_rows):
            for k in range(4):
                sums[STRESS_PART + k] += wp.float64(stress_count[row, k])
                stress_count[row, k] = wp.int64(0)
        renew_control(sums, control[world])
        if control[world, STATUS] == STATUS_RUNNING and control[world, STEP] >= control[world, LAST_STEP]:
            control[world, STATUS] = STATUS_WAITING
