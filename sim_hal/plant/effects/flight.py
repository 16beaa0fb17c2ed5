"""Forces of the air on what moves through it, and of the hinge that a testbed turns on."""

from __future__ import annotations

from sim_hal.plant.effects.base import Effect, EffectParameter, Form

_BALANCES = ("ballistic", "body_momentum", "force_balance")

DRAG_QUADRATIC = Effect(
    physics_id="aerodynamic_drag_quadratic",
    equation="ballistic",
    balances=_BALANCES,
    along_line=True,
    says="air drag with the square of speed",
    sentence="Air drag with the square of speed acts, drag area {cd_a} at air density {rho}.",
    citation="Rayleigh's drag equation; S. F. Hoerner, Fluid-Dynamic Drag (1965), ch. 1",
    forms=(
        Form(
            parameters=(
                EffectParameter(
                    "cd_a",
                    "m^2",
                    "min(0.05, 0.03 * F / V**2)",
                    "0",
                    "min(5, 5 * F / V**2)",
                    strength=True,
                    least=0.0,
                ),
                EffectParameter("rho", "kg/m^3", "1.2", "1.2", "1.2", constant=True, least=0.0),
            ),
            force="-0.5 * rho * cd_a * v * abs(v)",
        ),
    ),
)

DRAG_LINEAR = Effect(
    physics_id="aerodynamic_drag_linear",
    equation="ballistic",
    balances=_BALANCES,
    along_line=True,
    says="drag in proportion to speed",
    sentence="Drag in proportion to speed acts, {d}.",
    citation="G. G. Stokes (1851), drag at low Reynolds number",
    forms=(
        Form(
            parameters=(
                EffectParameter("d", "N*s/m", "0.02 * F / V", "0", "5 * F / V", strength=True, least=0.0),
            ),
            force="-d * v",
        ),
    ),
)

BUOYANCY = Effect(
    physics_id="buoyancy",
    equation="ballistic",
    balances=_BALANCES,
    along_line=True,
    says="a constant lift by the displaced air, or gravity smaller than modelled",
    sentence="A constant lift of {B} acts.",
    citation="Archimedes' principle",
    forms=(
        Form(
            parameters=(EffectParameter("B", "N", "0.02 * F", "-F", "F", strength=True),),
            force="B",
        ),
    ),
)

HINGE_FRICTION = Effect(
    physics_id="hinge_friction",
    equation="ballistic",
    balances=("body_momentum",),
    mechanical=False,
    says="dry friction in the testbed's hinge",
    sentence="Dry friction in the hinge holds the body back with {F_h} at the arm's radius.",
    citation="Wiśniewski et al., Energies 14 (2021) 4282, Section 3.4: hinge of the rotating testbed",
    forms=(
        Form(
            parameters=(EffectParameter("F_h", "N", "0.05", "0", "20", strength=True, least=0.0),),
            dry=("F_h", "F_h"),
            needs=("opened",),
        ),
    ),
)

EFFECTS = (DRAG_QUADRATIC, DRAG_LINEAR, BUOYANCY, HINGE_FRICTION)
