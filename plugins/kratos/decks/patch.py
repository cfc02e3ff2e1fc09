"""Print how far flat patches of Kratos' shell elements are from constant strain; the rim is moved as in that state.

A patch of 4 by 4 cells is of squares, of parallelograms, or of trapezoids. An element that passes the patch test has no
error but rounding, and corotational ones 1e-6 of large motions. Only Kratos and its own strategy are used, nothing of
shellbench.
"""

import KratosMultiphysics as km
from KratosMultiphysics import StructuralMechanicsApplication as structural

N, PAIRS = 4, (("DISPLACEMENT", "REACTION"), ("ROTATION", "REACTION_MOMENT"))
SMALL = 1e-6  # strain, so that corotational elements are linear
PLACES = {
    "squares": lambda i, j: (i, j),
    "parallelograms": lambda i, j: (i + 0.4 * j, j),
    "trapezoids": lambda i, j: (i, j * (1 + 0.1 * i)),
}
LAWS = {"ShellThickElement3D4N": "ReissnerMindlinShellElasticConstitutiveLaw"}


def error(kind, shape):
    """Return the largest error of an inner node's displacement, relative to the largest displacement."""
    model = km.Model()
    part = model.CreateModelPart("patch")
    for variable in (km.DISPLACEMENT, km.ROTATION, km.REACTION, km.REACTION_MOMENT):
        part.AddNodalSolutionStepVariable(variable)
    part.ProcessInfo[km.DOMAIN_SIZE] = 3
    part.SetBufferSize(2)
    of = part.CreateNewProperties(1)
    of[km.YOUNG_MODULUS], of[km.POISSON_RATIO], of[km.THICKNESS], of[km.DENSITY] = 2e6, 0.3, 0.1, 0.0
    of[km.CONSTITUTIVE_LAW] = getattr(structural, LAWS.get(kind, "LinearElasticPlaneStress2DLaw"))()
    exact, number = {}, lambda i, j: i * (N + 1) + j + 1
    for i in range(N + 1):
        for j in range(N + 1):
            x, y = PLACES[shape](i, j)
            part.CreateNewNode(number(i, j), x, y, 0.0)
            exact[number(i, j)] = SMALL * (x + y / 5), SMALL * (x / 5 - y / 2), 0.0
    for c in "XYZ":
        for moved, force in PAIRS:
            km.VariableUtils().AddDof(getattr(km, f"{moved}_{c}"), getattr(km, f"{force}_{c}"), part)
    rim = [number(i, j) for i in range(N + 1) for j in range(N + 1) if {i, j} & {0, N}]
    for node in rim:
        for c in "XYZ":
            part.GetNode(node).Fix(getattr(km, f"DISPLACEMENT_{c}"))
            part.GetNode(node).Fix(getattr(km, f"ROTATION_{c}"))
    for i in range(N):
        for j in range(N):
            a, b, c, d = number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)
            for corners in [(a, b, c), (a, c, d)] if kind.endswith("3N") else [(a, b, c, d)]:
                part.CreateNewElement(kind, part.NumberOfElements() + 1, list(corners), of)
    scheme = km.ResidualBasedIncrementalUpdateStaticScheme()
    builder = km.ResidualBasedBlockBuilderAndSolver(km.SkylineLUFactorizationSolver())
    strategy = km.ResidualBasedLinearStrategy(part, scheme, builder, True, False, False, False)
    strategy.Initialize()
    for node in (part.GetNode(number) for number in rim):
        node.SetSolutionStepValue(km.DISPLACEMENT, list(exact[node.Id]))
        node.X, node.Y = node.X0 + exact[node.Id][0], node.Y0 + exact[node.Id][1]  # corotational elements look here
    strategy.Solve()
    found = {node.Id: node.GetSolutionStepValue(km.DISPLACEMENT) for node in part.Nodes}
    largest = max(abs(c) for moved in exact.values() for c in moved)
    return max(abs(a - b) for node, moved in exact.items() for a, b in zip(found[node], moved, strict=True)) / largest


if __name__ == "__main__":
    for kind in (
        "ShellThinElementCorotational3D4N",
        "ShellThinElement3D3N",
        "ShellThickElement3D4N",
        "ShellThickElementCorotational3D3N",
    ):
        print(kind, {shape: f"{error(kind, shape):.1e}" for shape in PLACES})
