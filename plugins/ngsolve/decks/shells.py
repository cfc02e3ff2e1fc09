"""Solve the Scordelis-Lo roof or a square plate with NGSolve, by a script of its own: no code of shellbench.

    python shells.py roof              # thin (HHJ): .3005925
    python shells.py roof shear        # with shear (TDNNS) and soft diaphragms: .302025; `hard`: .301454
    python shells.py plate             # thin: .4874823
    python shells.py hyperboloid       # Neunteufel & Schoeberl's example, t = .01: .1502913 (thin)

The mesh is Netgen's, curved by Netgen (`Curve`); the shell is whole. The forms are those of the notebooks at
github.com/MichaelNeunteufel/hhj_tdnns_nonlinear_shells.
"""

import math
import os
import sys
import time

import netgen.meshing as netgen
import ngsolve as ng
from ngsolve import Grad, Id, InnerProduct, Interpolate, OuterProduct, Sym, Trace, ds, specialcf

HALF, DEGREE = math.radians(40), 3
NORMAL = specialcf.normal(3)


def roof():
    """Return a map of the unit square, E, nu, h, load, held sides by component, sides that can't turn, and a point."""

    def place(s, t, _):
        return 25 * math.sin(HALF * (2 * s - 1)), 25 * math.cos(HALF * (2 * s - 1)), 50 * (t - 0.5)

    at = (25 * math.sin(HALF), 25 * math.cos(HALF), 0)
    return place, 4.32e8, 0.0, 0.25, ng.CF((0, -90, 0)), ["bottom|top", "bottom|top", ""], "", at, 1


def plate():
    """Return the same of the simply supported plate."""
    rim = "left|right|bottom|top"
    return lambda s, t, _: (100 * s, 100 * t, 0), 1e7, 0.0, 1.0, ng.CF((0, 0, -1)), [rim] * 3, "", (50, 50, 0), 2


def hyperboloid():
    """Return the same of an eighth of a hyperboloid between planes of symmetry and a free rim."""

    def place(s, t, _):
        return s, math.sqrt(1 + s * s) * math.cos(math.pi / 2 * t), math.sqrt(1 + s * s) * math.sin(math.pi / 2 * t)

    zeta = ng.IfPos(ng.y, ng.atan(ng.z / ng.y), math.pi / 2)
    load = 1e4 * 0.01**3 * ng.cos(2 * zeta) * -NORMAL
    return place, 2.85e4, 0.3, 0.01, load, ["left", "top", "bottom"], "left|bottom|top", (0, 0, 1), 2


def solve(shell, n, shear, hard):
    """Return a displacement of a point, downward, by n x n cells of two triangles."""
    place, youngs, nu, h, load, held, still, at, component = shell()
    mesh = ng.Mesh(netgen.SurfaceGeometry(place).GenerateMesh(quads=False, nx=n, ny=n))
    mesh.Curve(DEGREE)
    conormal = ng.Cross(NORMAL, specialcf.tangential(3))
    project = Id(3) - OuterProduct(NORMAL, NORMAL)
    given = {f"dirichlet{'xyz'[c]}_bbnd": names for c, names in enumerate(held) if names}
    spaces = [
        ng.VectorH1(mesh, order=DEGREE, **given),
        ng.HDivDivSurface(mesh, order=DEGREE - 1, discontinuous=True),
        ng.NormalFacetSurface(mesh, order=DEGREE - 1, dirichlet_bbnd=still),
    ]
    if shear:
        spaces.append(ng.HCurl(mesh, order=DEGREE - 1, dirichlet_bbnd="bottom|top|left|right" if hard else ""))
    regge = ng.HCurlCurl(mesh, order=DEGREE - 1, discontinuous=True)
    space = ng.FESpace(spaces)
    (u, m, a, *g), (du, dm, da, *dg) = space.TnT()
    m, a, dm, da = m.Trace(), a.Trace(), dm.Trace(), da.Trace()
    bend, dbend = ((v.Operator("hesseboundary").trans * NORMAL).Reshape((3, 3)) for v in (u, du))
    turn, dturn = Grad(u).Trace()[NORMAL, conormal], Grad(du).Trace()[NORMAL, conormal]
    form = ng.BilinearForm(space, symmetric=True, condense=True)
    if shear:
        g, dg = g[0].Trace(), dg[0].Trace()
        bend, dbend, turn, dturn = bend - Grad(g), dbend - Grad(dg), turn - g * conormal, dturn - dg * conormal
        form += h * 5 / 6 * youngs / 2 / (1 + nu) * g * dg * ds
    e, de = (Interpolate(Sym(project * Grad(v).Trace()), regge) for v in (u, du))
    form += h * youngs / (1 - nu**2) * InnerProduct((1 - nu) * e + nu * Trace(e) * project, de) * ds
    form += -12 / h**3 * (1 + nu) / youngs * InnerProduct(m - nu / (nu + 1) * Trace(m) * project, dm) * ds
    form += (InnerProduct(dm, bend) + InnerProduct(m, dbend)) * ds
    form += (-m[conormal, conormal] * (dturn - da * conormal)) * ds(element_boundary=True)
    form += (-dm[conormal, conormal] * (turn - a * conormal)) * ds(element_boundary=True)
    if shell is roof:
        form += 1e-9 * youngs * u[2] * du[2] * ds  # against the axial rigid motion
    work = ng.LinearForm(space)
    work += InnerProduct(load, du) * ds
    form.Assemble()
    work.Assemble()
    found = ng.GridFunction(space)
    right = (work.vec + form.harmonic_extension_trans * work.vec).Evaluate()
    found.vec.data = form.mat.Inverse(space.FreeDofs(True), inverse="sparsecholesky") * right
    found.vec.data += form.harmonic_extension * found.vec
    found.vec.data += form.inner_solve * right
    return -found.components[0](mesh(*at, ng.BND))[component], space.ndof


if __name__ == "__main__":
    for cells in (4, 8, 16):
        begin = time.perf_counter()
        value, unknowns = solve(globals()[sys.argv[1]], cells, "shear" in sys.argv, "hard" in sys.argv)
        spent = time.perf_counter() - begin
        print(f"{' '.join(sys.argv[1:])}, n = {cells:2d}: {value:.8f}, {unknowns} unknowns, {spent:.2f} s")
    sys.stdout.flush()
    os._exit(0)  # NGSolve 6.2.2608 crashes while Python frees its objects
