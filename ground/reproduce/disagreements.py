"""Where the published numbers disagree with each other, each with the arithmetic that shows it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from flight.settings import RigSettings
from ground.calibration.hop_model import on_arm
from ground.reproduce.moon import moon_height_m
from ground.reproduce.paper import Paper


@dataclass(frozen=True)
class Disagreement:
    """What does not fit together, where it stands, and what was done about it here."""

    title: str
    text: str
    here: str


def disagreements(paper: Paper, rig: RigSettings) -> list[Disagreement]:
    """All that was found, worked out from the published numbers."""
    return [
        *_masses(paper),
        *_springs(paper),
        *_loss_free(paper, rig),
        *_ranges(paper),
        *_text(paper),
        *_moon(paper),
    ]


def _masses(paper: Paper) -> Iterator[Disagreement]:
    masses, radius = paper.masses_kg, paper.com_radius
    axis = masses["rotational_axis"]
    moving = sum(masses.values()) - axis
    bare = paper.feet["0"]
    yield Disagreement(
        "Moving mass",
        f"Table 3's masses without the rotational axis add up to {moving:.3f} kg, with it to {moving + axis:.3f} kg. "
        f"Which of the two weighs at L_CoM = {radius.value:g} m is not said; E_pot = M g h differs by "
        f"{100 * axis / moving:.0f} %. I_total/L² gives {bare.total_inertia_kg_m2 / radius.value**2:.3f} kg, which "
        "is neither and need not be: inertia about the hinge also holds the parts' spread along the arm.",
        f"M = {moving:.2f} kg plus the foot: the axis turns about itself and is not lifted.",
    )
    leg = masses["actuating_leg"] + 0.5 * masses["springs"]
    reach = math.sqrt(bare.leg_inertia_kg_m2 / leg)
    heavy = max(paper.feet.values(), key=lambda foot: foot.mass_kg)
    moved = (moving * radius.value + heavy.mass_kg * reach) / (moving + heavy.mass_kg) - radius.value
    yield Disagreement(
        "Radius of the centre of mass",
        f"One L_CoM = {1e3 * radius.value:.0f} ± {1e3 * radius.std:.0f} mm is given for all feet. Table 3's inertias "
        f"put leg and foot at {1e3 * reach:.0f} mm from the hinge (I_leg over the leg with half the springs; the "
        f"feet's share gives the same), so that the foot of {1e3 * heavy.mass_kg:.0f} g moves the centre of mass out "
        f"by {1e3 * moved:.0f} mm, beyond the stated accuracy.",
        "L_CoM is kept; the springs act at that radius, as in the nominal plant.",
    )
    areas = {name: foot for name, foot in paper.feet.items() if foot.area_m2 and foot.shape == "flat"}
    small, large = (pick(areas, key=lambda n: areas[n].area_m2 or 0.0) for pick in (min, max))
    yield Disagreement(
        "Masses of the feet",
        f"The smallest flat foot (#{small}, {1e4 * (areas[small].area_m2 or 0):.0f} cm²) is the heaviest with "
        f"{1e3 * areas[small].mass_kg:.1f} g, the largest (#{large}, {1e4 * (areas[large].area_m2 or 0):.0f} cm²) "
        f"weighs {1e3 * areas[large].mass_kg:.1f} g. The inertias agree with these masses.",
        "Taken as published.",
    )


def _springs(paper: Paper) -> Iterator[Disagreement]:
    energies, forces = paper.campaign.spring_energy_j, paper.campaign.spring_force_n
    low, high = (
        force**2 / (2.0 * e) for force, e in ((forces.low, energies.low), (forces.high, energies.high))
    )
    yield Disagreement(
        "Stiffness of the springs",
        f"The ends of the published ranges, k = F²/2E, give {low / 1e3:.2f} and {high / 1e3:.2f} kN/m: they agree "
        f"within {100 * abs(low / high - 1.0):.1f} %. No disagreement, but the only hold on k, which is not given.",
        "k = 30.6 kN/m ± 2 %.",
    )


def _loss_free(paper: Paper, rig: RigSettings) -> Iterator[Disagreement]:
    feet = []
    for name, foot in paper.feet.items():
        here = on_arm(rig, name).equivalent
        compression_m = 0.033
        gravity = 2.0 * here.body_mass_kg * here.gravity_m_s2 / (rig.spring_stiffness_n_m * compression_m)
        # E_used holds the body's fall while tensioning, which is not shared with the leg: C1 = C1_expected/(1 + G/S)
        free = foot.leg_inertia_kg_m2 / foot.total_inertia_kg_m2 / (1.0 + gravity)
        feet.append(f"#{name}: {100 * free:.1f} against {100 * foot.c1.mean:.1f} %")
    yield Disagreement(
        "The loss-free analysis is not loss-free",
        "With E_used = E_spr − E_grav and the height counted from the compressed start, a loss-free hop must give a "
        "C1 below I_leg/I_total, because the work of gravity on the body is given back whole. That makes "
        f"{'; '.join(feet)} (Table 4). The published values ask for a loss of 2 to 4 % in the analysis itself.",
        "C1 is shown both ways: loss-free by the flight code, and with one minimal damping for all feet.",
    )
    bare, small = paper.feet["0"].c1, paper.feet["2"].c1
    assert bare.low is not None and bare.high is not None and small.low is not None and small.high is not None
    yield Disagreement(
        "Spread of C1",
        f"For one mass distribution C1 of the analysis spans {100 * bare.low:.1f} to {100 * bare.high:.1f} % (foot "
        f"0), but {100 * small.low:.2f} to {100 * small.high:.2f} % for foot 2. Between 15.3 and 24.0 J the energy "
        "alone moves C1 by less than a point.",
        "Our spread is that of the energies, and smaller.",
    )


def _ranges(paper: Paper) -> Iterator[Disagreement]:
    aggregate = paper.row("quartz_aggregate", "1", 0.0)
    clay = paper.row("expanded_clay", "1", 0.0)
    assert aggregate is not None and clay is not None
    yield Disagreement(
        "Range of C3 in abstract and conclusions",
        f"“4 % to 53 %” takes its low end from one column of Table 5 ({100 * (aggregate.c3_average.low or 0):.1f} %, "
        f"C2_ref average) and its high end from the other ({100 * (clay.c3_direct.high or 0):.1f} %, C2_ref direct), "
        "and leaves out the tilted runs, which reach 68.9 %. The ranges of clay and aggregate are mixed likewise.",
        "The columns are kept apart.",
    )
    sand = paper.row("quartz_sand", "1", 0.0)
    tilted = paper.row("quartz_sand", "1", paper.tilt.tilt_deg)
    assert sand is not None and tilted is not None
    direct = tilted.c3_direct.mean / sand.c3_direct.mean
    average = tilted.c3_average.mean / sand.c3_average.mean
    yield Disagreement(
        "Factor of the tilt",
        f"“A factor of 1.5, from 39 % to 58 %” holds for C2_ref average ({average:.2f}); by C2_ref direct it is "
        f"{direct:.2f}.",
        "Compared with the column that it was taken from.",
    )
    implied = 1.0 - (1.0 - paper.c2_ref_all.mean) * (1.0 - sand.c3_average.mean) / (1.0 - sand.c3_direct.mean)
    yield Disagreement(
        "C2_ref direct and average",
        "They should agree. The two columns of Table 5 imply a direct C2_ref of "
        f"{100 * implied:.1f} % on level sand against {100 * paper.c2_ref_all.mean:.1f} % on average, and 2.0 % on "
        "clay and aggregate: the mechanism, or the measurement, differed from day to day by more than its mean.",
        "Used to work out which set-up lost how much.",
    )
    syar = paper.row("syar", "1", 0.0)
    assert syar is not None and syar.c3_direct.low and syar.c3_direct.high
    yield Disagreement(
        "Compaction of Syar",
        f"The text has C3 fall “around 3 times” in four jumps, its range in Table 5 is "
        f"{syar.c3_direct.high / syar.c3_direct.low:.1f}-fold.",
        "The calibration aims at the mean, the threefold fall and the range together, and lands between them.",
    )


def _text(paper: Paper) -> Iterator[Disagreement]:
    tilted = paper.row("quartz_sand", "1", paper.tilt.tilt_deg)
    assert tilted is not None
    yield Disagreement(
        "Number of tilted runs",
        f"Section 3.4 speaks of three runs at 20°, Tables 5 and 6 of {tilted.runs}.",
        f"{tilted.runs} runs are flown.",
    )
    runs = {name: foot.c1.runs or 0 for name, foot in paper.feet.items()}
    apart = {
        name: abs(foot.c1.mean / (foot.leg_inertia_kg_m2 / foot.total_inertia_kg_m2) - 1.0)
        for name, foot in paper.feet.items()
    }
    mean = sum(runs[name] * apart[name] for name in runs) / sum(runs.values())
    yield Disagreement(
        "Error of the simplified C1 model",
        f"Stated as {100 * paper.c1_model_error:.1f} %; the means of Table 4 are {100 * mean:.1f} % away from Eq. "
        "(1), weighted by runs. Single runs may scatter more, so this can neither be confirmed nor refuted.",
        "Ours is given over all runs.",
    )


def _moon(paper: Paper) -> Iterator[Disagreement]:
    moon = paper.moon
    one = moon_height_m(moon, 0.0, 1)
    spans = [moon_height_m(moon, c3, moon.legs) for c3 in (moon.c3_high, moon.c3_low)]
    yield Disagreement(
        "Energy of Hopter on the Moon",
        f"Table 1 has E_spr > {moon.spring_energy_j:g} J as the total in the drive springs. Eq. (6) with that lifts "
        f"{moon.mass_kg:g} kg by {one:.1f} m at most, even where the ground takes nothing; Figure 23's "
        f"{moon.height_low_m:g} to {moon.height_high_m:g} m need {moon.spring_energy_j:g} J in each of the "
        f"{moon.legs} legs, which give {spans[0]:.1f} to {spans[1]:.1f} m.",
        "Both are drawn; the numbers compared with Figure 23 are those of three times 50 J.",
    )
