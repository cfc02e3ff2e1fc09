"""Solve Kratos' own example of all four shell elements: prints the deflection under the force, and Kratos' reference.

It is shell_test/Shell_T3andQ4_linear_static_struct_pinched_cylinder among the tests of StructuralMechanicsApplication:
an eighth of a pinched cylinder with diaphragms, radius and half length 300, a quarter of it for each element.
"""

from math import cos, radians, sin

import KratosMultiphysics as km
from KratosMultiphysics import StructuralMechanicsApplication as structural

REFERENCE = -1.176534805782e-05  # of the file of results there
PLACES = "04 03 14 13 02 12 01 24 23 11 22 00 21 10 34 33 32 20 31 44 43 30 42 41 40"
"""Of node 1, 2, ...: steps around from the force, 22.5 degrees each, and along from the diaphragm, 75 each."""
ELEMENTS = {
    "ShellThickElement3D4N": "7 10 14 12|5 6 10 7|10 13 18 14|6 11 13 10",
    "ShellThickElementCorotational3D3N": "13 19 18|19 22 18|11 17 13|17 19 13|19 24 22|24 25 22|17 23 19|23 24 19",
    "ShellThinElementCorotational3D4N": "9 16 17 11|8 15 16 9|16 21 23 17|15 20 21 16",
    "ShellThinElement3D3N": "2 4 5|4 6 5|1 3 2|3 4 2|4 9 6|9 11 6|3 8 4|8 9 4",
}
PAIRS = (("DISPLACEMENT", "REACTION"), ("ROTATION", "REACTION_MOMENT"))
HELD = {  # place's digit and its value -> components
    (0, "4"): "DISPLACEMENT_Z ROTATION_X ROTATION_Y",
    (1, "4"): "DISPLACEMENT_Y ROTATION_X ROTATION_Z",
    (0, "0"): "DISPLACEMENT_X ROTATION_Y ROTATION_Z",
    (1, "0"): "DISPLACEMENT_X DISPLACEMENT_Z",
}


def deflection():
    """Return the displacement along z under the force."""
    model = km.Model()
    part = model.CreateModelPart("cylinder")
    for variable in (km.DISPLACEMENT, km.ROTATION, km.REACTION, km.REACTION_MOMENT, structural.POINT_LOAD):
        part.AddNodalSolutionStepVariable(variable)
    part.ProcessInfo[km.DOMAIN_SIZE] = 3
    part.SetBufferSize(2)
    for number, (around, along) in enumerate(PLACES.split(), 1):
        angle = radians(22.5 * int(around))
        part.CreateNewNode(number, 300 * sin(angle), 75.0 * int(along), 300 * cos(angle))
    for c in "XYZ":
        for moved, force in PAIRS:
            km.VariableUtils().AddDof(getattr(km, f"{moved}_{c}"), getattr(km, f"{force}_{c}"), part)
    for number, place in enumerate(PLACES.split(), 1):
        for (digit, value), components in HELD.items():
            for component in components.split() if place[digit] == value else ():
                part.GetNode(number).Fix(getattr(km, component))
    for tag, (kind, cells) in enumerate(ELEMENTS.items(), 1):
        of = part.CreateNewProperties(tag)
        of[km.YOUNG_MODULUS], of[km.POISSON_RATIO], of[km.THICKNESS], of[km.DENSITY] = 3e6, 0.3, 3.0, 0.0
        mindlin = kind == "ShellThickElement3D4N"
        law = "ReissnerMindlinShellElasticConstitutiveLaw" if mindlin else "LinearElasticPlaneStress2DLaw"
        of[km.CONSTITUTIVE_LAW] = getattr(structural, law)()
        for nodes in cells.split("|"):
            part.CreateNewElement(kind, part.NumberOfElements() + 1, [int(node) for node in nodes.split()], of)
    part.CreateNewCondition("PointLoadCondition3D1N", 1, [1], part.GetProperties(1))
    part.GetNode(1).SetSolutionStepValue(structural.POINT_LOAD, [0.0, 0.0, -0.25])
    scheme = km.ResidualBasedIncrementalUpdateStaticScheme()
    builder = km.ResidualBasedBlockBuilderAndSolver(km.SkylineLUFactorizationSolver())
    strategy = km.ResidualBasedLinearStrategy(part, scheme, builder, True, False, False, False)
    strategy.Initialize()
    strategy.Solve()
    return part.GetNode(1).GetSolutionStepValue(km.DISPLACEMENT_Z)


if __name__ == "__main__":
    print(deflection(), REFERENCE)
