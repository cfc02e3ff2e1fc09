"""Solve the Scordelis-Lo roof with a shell element of Kratos: `python deck.py ShellThinElement3D3N 16`.

The whole roof has n by n cells, n even. A cell's load is put on its corners in equal shares, and Kratos' own strategy
and linear solver find the displacements. Only Kratos is used, nothing of shellbench. Prints how far the middle of the
roof's edge sinks. The constitutive law must be the element's: another one makes Kratos 10.4 crash.
"""

import sys
from math import cos, radians, sin

import KratosMultiphysics as km
from KratosMultiphysics import StructuralMechanicsApplication as structural

LOAD = 90.0 * 25 * radians(80) * 50  # radius 25, 80 degrees, length 50
PAIRS = (("DISPLACEMENT", "REACTION"), ("ROTATION", "REACTION_MOMENT"))
MINDLIN = ("ShellThickElement3D4N", "CSDSG3ThickShellLinearElement3D3N")  # of another constitutive law


def deflection(kind, n, first=0):
    """Return the deflection on n by n cells; the lists of a triangle's corners begin `first` corners later."""
    model = km.Model()
    part = model.CreateModelPart("roof")
    for variable in (km.DISPLACEMENT, km.ROTATION, km.REACTION, km.REACTION_MOMENT, structural.POINT_LOAD):
        part.AddNodalSolutionStepVariable(variable)
    part.ProcessInfo[km.DOMAIN_SIZE] = 3
    part.SetBufferSize(2)
    of = part.CreateNewProperties(1)
    of[km.YOUNG_MODULUS], of[km.POISSON_RATIO], of[km.THICKNESS], of[km.DENSITY] = 4.32e8, 0.0, 0.25, 0.0
    law = "ReissnerMindlinShellElasticConstitutiveLaw" if kind in MINDLIN else "LinearElasticPlaneStress2DLaw"
    of[km.CONSTITUTIVE_LAW] = getattr(structural, law)()
    number, angle = lambda i, j: i * (n + 1) + j + 1, lambda i: radians(40) * (2 * i / n - 1)
    for i in range(n + 1):
        for j in range(n + 1):
            part.CreateNewNode(number(i, j), 25 * sin(angle(i)), 50 * j / n, 25 * cos(angle(i)))
    for c in "XYZ":
        for moved, force in PAIRS:
            km.VariableUtils().AddDof(getattr(km, f"{moved}_{c}"), getattr(km, f"{force}_{c}"), part)
    loads = dict.fromkeys(range(1, (n + 1) ** 2 + 1), 0.0)
    for i in range(n):
        for j in range(n):
            a, b, c, d = number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)
            parts = [(a, b, c), (a, c, d)] if kind.endswith("3N") else [(a, b, c, d)]
            for corners in (cell[first:] + cell[:first] for cell in parts):
                part.CreateNewElement(kind, part.NumberOfElements() + 1, list(corners), of)
                for node in corners:
                    loads[node] -= LOAD / n**2 / len(parts) / len(corners)
    for i in range(n + 1):
        for j in (0, n):
            part.GetNode(number(i, j)).Fix(km.DISPLACEMENT_X)
            part.GetNode(number(i, j)).Fix(km.DISPLACEMENT_Z)
    part.GetNode(number(n // 2, n // 2)).Fix(km.DISPLACEMENT_Y)
    for node, load in loads.items():
        part.CreateNewCondition("PointLoadCondition3D1N", node, [node], of)
        part.GetNode(node).SetSolutionStepValue(structural.POINT_LOAD, [0.0, 0.0, load])
    scheme = km.ResidualBasedIncrementalUpdateStaticScheme()
    builder = km.ResidualBasedBlockBuilderAndSolver(km.SkylineLUFactorizationSolver())
    strategy = km.ResidualBasedLinearStrategy(part, scheme, builder, True, False, False, False)
    strategy.Initialize()
    strategy.Solve()
    return -part.GetNode(number(0, n // 2)).GetSolutionStepValue(km.DISPLACEMENT_Z)


if __name__ == "__main__":
    print(deflection(sys.argv[1], int(sys.argv[2])))
