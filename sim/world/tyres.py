"""The rubber of the tyres: a spring and a damper in each contact of a wheel.

A tread of 12 mm of solid rubber, 30 mm wide, on a rigid hub of a wheel of 0.1 m. As an elastic
foundation (Johnson, Contact Mechanics, 1985, section 4.3) of rubber of hardness 50 Shore A, whose
Young's modulus is 2.5 MPa (Gent, Rubber Chemistry and Technology 31, 1958), it yields 0.58 mm under
36 N, a third of the rover's weight: 63 kN/m.
"""

import mujoco

from sim.world.rover import CONTACT_GROUP, WHEEL_BODIES

STIFFNESS_N_PER_M = 60e3
DAMPING_NS_PER_M = 230.0
"""A quarter of critical with a third of the rover's mass: a loss factor of 0.5, as of butyl."""
ONSET_M = 0.3e-3
"""Deflection over which spring and damper set in, so that no force begins with a jump."""
IMPEDANCE = 0.3
"""MuJoCo's weight of the constraint; a small one makes it a spring, see `set_tyre_contacts`."""
IMPEDANCE_RATIO = 300.0
"""MuJoCo's `impratio`: damping of sliding in the tyres' contacts, as multiple of that of their
deflection; keeps wheels at rest from creeping sideways."""


def set_tyre_contacts(model: mujoco.MjModel) -> None:
    """Let the tyres decide stiffness and damping of their contacts; friction stays as it is.

    With impedance d, MuJoCo's direct reference (-k, -c) and the inverse A of the mass that the
    wheel moves with, which MuJoCo takes for each body alone, the force at a deflection r beyond the
    onset is (k r + c v) / (A (1 - d)), less the acceleration times d / (A (1 - d)): 1.6 kg here.

    Source:
        MuJoCo's documentation, Computation, section on constraint solver parameters.
    """
    for name in WHEEL_BODIES:
        body = model.body(name).id
        scale = (1 - IMPEDANCE) * model.body_invweight0[body, 0]
        tyre = (model.geom_bodyid == body) & (model.geom_group == CONTACT_GROUP)
        model.geom_solref[tyre] = -STIFFNESS_N_PER_M * scale, -DAMPING_NS_PER_M * scale
        model.geom_solimp[tyre] = 0.0, IMPEDANCE, ONSET_M, 0.5, 1.0
        model.geom_solmix[tyre] = 1e6  # against that of what they touch
