"""What the tool does not do, and the words of a campaign file that ask for it."""

from __future__ import annotations

#: Shown by `python3 -m campaign --help`.
SCOPE = """\
What this tool does not do:
  loading: cyclic loading, creep, rate effects, simple or direct shear, true triaxial tests, gravity
  grains: crushing, wear, other shapes than spheres
  contacts: cohesion, bonds, rolling resistance, damping that depends on velocity; the law is Hertz, Mindlin, Coulomb
  water and heat: fluid flow, partial saturation, liquid bridges, temperature
  boundaries: walls, platens and membranes; the cell is periodic, and its strain is homogeneous"""

#: What is asked for -> words of keys that ask for it. A word also answers for keys of which it is a part between "_".
_ASKED: dict[str, str] = {
    "cyclic or repeated loading": "cyclic cycle cycles n_cycles ncycles cyclical amplitude csr crr earthquake",
    "creep or other effects of time": "creep ageing aging viscous",
    "other tests than triaxial ones": "oedometer shearbox torsion torsional simple_shear direct_shear true_triaxial "
    "b_value hollow_cylinder lode lode_angle",
    "gravity or fields": "gravity slope foundation",
    "crushing or wear of grains": "crushing crushable crush crushed breakage fragmentation grain_strength wear",
    "grains that are not spheres": "shape shapes aspect_ratio aspect elongation flatness sphericity roundness "
    "angularity clump clumps polyhedra polyhedron ellipsoid ellipsoids superquadric nonspherical non_spherical",
    "cohesion, bonds or cementation": "cohesion cohesive adhesion adhesive bond bonds bonded bonding bond_strength "
    "bond_stiffness cement cementation tensile_strength jkr dmt van_der_waals",
    "rolling or twisting resistance": "rolling mu_r mu_roll twisting twist mu_tw",
    "damping in the contact": "restitution dashpot viscous_damping",
    "flow of water, partial saturation or liquid bridges": "water fluid liquid saturation unsaturated suction moisture "
    "capillary capillarity liquid_bridge surface_tension permeability seepage cfd",
    "heat": "temperature thermal heat freezing ice frost",
    "walls, platens or membranes": "wall walls wall_friction rigid_wall platen platens membrane boundary boundaries",
}
_ANSWERS = {word: asked for asked, words in _ASKED.items() for word in words.split()}


def out_of_scope(name: str) -> str:
    """The sentence for a name in a campaign file that asks for what the tool does not do; "" for any other name.

    >>> out_of_scope("rolling_friction")
    'the tool does not do rolling or twisting resistance (python3 -m campaign --help lists its limits)'
    >>> out_of_scope("strain_ends")
    ''
    """
    word = name[:60].lower().replace("-", "_").replace(" ", "_")
    parts = [word, *(part for part in word.split("_") if len(part) > 4)]
    asked = next((_ANSWERS[part] for part in parts if part in _ANSWERS), "")
    return f"the tool does not do {asked} (python3 -m campaign --help lists its limits)" if asked else ""
