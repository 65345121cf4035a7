"""One hovering flight in PteraSoftware, timed; run by compare.py in its environment.

Prints one JSON object. Compiling (numba) is done by a tiny flight first and timed apart.
"""

import json
import sys
import time
import warnings

import numba
import numpy
import pterasoftware as ps

# The hawkmoth's: a rectangular wing of its length and mean chord, flapping at case five-ann.
LENGTH, CHORD, HINGE = 0.0485, 0.0183, 0.008
FREQUENCY, SWEEP, ROTATION = 26.8, 60.0, 60.5


def section(panels, along):
    return ps.geometry.wing_cross_section.WingCrossSection(
        airfoil=ps.geometry.airfoil.Airfoil(name="naca0012"),
        num_spanwise_panels=panels,
        chord=CHORD,
        Lp_Wcsp_Lpp=(0.0, along, 0.0),
        spanwise_spacing="uniform" if panels else None,
    )


def wing(chordwise, spanwise, mirrored):
    plane = {"symmetryNormal_G": (0.0, 1.0, 0.0), "symmetryPoint_G_Cg": (0.0, 0.0, 0.0)} if mirrored else {}
    return ps.geometry.wing.Wing(
        wing_cross_sections=[section(spanwise, 0.0), section(None, LENGTH)],
        Ler_Gs_Cgs=(0.0, HINGE, 0.0),
        symmetric=False,
        mirror_only=mirrored,
        num_chordwise_panels=chordwise,
        chordwise_spacing="uniform",
        **plane,
    )


def flap(base):
    """Sweep about x, so the stroke plane is y-z and lift is along -x; rotation about the span, 90 degrees apart."""
    sections = [
        ps.movements.wing_cross_section_movement.WingCrossSectionMovement(base_wing_cross_section=s)
        for s in base.wing_cross_sections
    ]
    period = 1.0 / FREQUENCY
    return ps.movements.wing_movement.WingMovement(
        base_wing=base,
        wing_cross_section_movements=sections,
        ampAngles_Gs_to_Wn_ixyz=(SWEEP, ROTATION, 0.0),
        periodAngles_Gs_to_Wn_ixyz=(period, period, 0.0),
        phaseAngles_Gs_to_Wn_ixyz=(0.0, 90.0, 0.0),
    )


def problem(chordwise, spanwise, steps_per_stroke, steps):
    airplane = ps.geometry.airplane.Airplane(
        wings=[wing(chordwise, spanwise, False), wing(chordwise, spanwise, True)],
        s_ref=2.0 * LENGTH * CHORD,
        c_ref=CHORD,
        b_ref=2.0 * LENGTH,
    )
    # A zero free stream is refused; this one is as good as none.
    point = ps.operating_point.OperatingPoint(rho=1.225, vCg__E=1e-9, alpha=0.0)
    movement = ps.movements.movement.Movement(
        airplane_movements=[
            ps.movements.airplane_movement.AirplaneMovement(
                base_airplane=airplane, wing_movements=[flap(w) for w in airplane.wings]
            )
        ],
        operating_point_movement=ps.movements.operating_point_movement.OperatingPointMovement(
            base_operating_point=point
        ),
        delta_time=1.0 / (FREQUENCY * steps_per_stroke),
        num_steps=steps,
    )
    return ps.problems.UnsteadyProblem(movement=movement)


def fly(chordwise, spanwise, steps_per_stroke, strokes):
    start = time.perf_counter()
    case = problem(chordwise, spanwise, steps_per_stroke, steps_per_stroke * strokes)
    solver = ps.unsteady_ring_vortex_lattice_method.UnsteadyRingVortexLatticeMethodSolver(unsteady_problem=case)
    built = time.perf_counter()
    solver.run(prescribed_wake=False, calculate_streamlines=False, show_progress=False)
    done = time.perf_counter()
    last = case.steady_problems[-2 * steps_per_stroke :]
    # Wind axes: x against the stream, which is along the body: lift here.
    force = numpy.mean([step.airplanes[0].forces_W for step in last], axis=0)
    return {"build_s": built - start, "run_s": done - built, "mean_force_last_two_strokes_n": [float(f) for f in force]}


def main():
    chordwise, spanwise, steps_per_stroke, strokes, runs = map(int, sys.argv[1:])
    warnings.simplefilter("ignore")
    start = time.perf_counter()
    fly(2, 2, 4, 2)
    compiled = time.perf_counter() - start
    flights = [fly(chordwise, spanwise, steps_per_stroke, strokes) for _ in range(runs)]
    versions = {"numpy": numpy.__version__, "numba": numba.__version__, "python": sys.version.split()[0]}
    json.dump({"warm_up_s": compiled, "flights": flights, "versions": versions}, sys.stdout)


main()
