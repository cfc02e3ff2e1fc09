"""The weak forms of NGSolve's linear shells, after Neunteufel & Schoeberl (arXiv:2304.13806) and their notebooks.

Thin shells (HHJ): displacement u, continuous; bending moments m, whose part m_nn normal to element sides is continuous,
which a variable on the sides (the rotation about a side) enforces; membrane strains interpolated into Regge's space
against locking. Shells with shear (TDNNS) add the shear g, tangentially continuous: normals turn by grad u - g.

    h/2 |R eps(u)|^2_C - 6/h^3 |m|^2_(1/C) + m : (hess u . n - grad g)
        - sides m_cc (n . grad u . c - g . c - a . c) + k G h/2 |g|^2,   c the direction across a side
"""

from __future__ import annotations

from typing import Any

import ngsolve
import numpy as np
from ngsolve import Grad, Id, InnerProduct, Interpolate, OuterProduct, Sym, Trace, ds, specialcf
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.question.places import Edge
from shellbench_ngsolve.elements import SIDES, CurvedMesh

SHEAR_FACTOR = 5 / 6
REFINEMENTS = 3  # steps of iterative refinement
STILL = 1e-5  # relative change of unknowns by the last of them; on thin strips rounding leaves 2e-7


def held_sides(deck: Deck) -> tuple[dict[str, list[int]], set[str], set[str]]:
    """Return the components that sides hold, the sides that can't turn about themselves, and those that hold shear."""
    case, still, hard = deck.part.case, set[str](), set[str]()
    components: dict[str, list[int]] = {}
    for number, name in enumerate(SIDES):
        axis, last = divmod(number, 2)
        if not deck.grid.closed[axis]:
            inner = deck.grid.edge(axis, bool(last))[1:-1]
            components[name] = [c for c in range(3) if bool(deck.held[inner, c].all())]
    for support, place in case.supported_places():
        if not isinstance(place, Edge):
            continue
        side = f"xi{place.axis + 1}_{place.side}"
        if support.clamped or support.symmetry is not None:
            still.add(side)
        number = SIDES.index(side)
        turned = int(np.sum(np.all(deck.held[deck.grid.edge(number // 2, bool(number % 2))[1:-1], 3:], axis=0)))
        if support.symmetry is None and turned > (1 if support.clamped else 0):
            hard.add(side)
    return components, still, hard


def solve(deck: Deck, degree: int, shear: bool) -> tuple[NDArray[np.float64], int]:
    """Return the displacements (v, 3) of a deck's nodes, m, and the number of unknowns.

    The deck's cells are triangles of six nodes.

    Raises
    ------
    SolveFailure
        If the equations are not solved.
    """
    corners = Deck.of(deck.part, deck.grid.counts, "tri3", deck.grid.distortion, deck.at)
    curved = CurvedMesh(corners, degree)
    mesh, material = curved.mesh, deck.part.case.isotropic
    curved.curve()
    sides, still, hard = held_sides(deck)
    names = ["|".join(name for name, held in sides.items() if c in held) for c in range(3)]
    given = {f"dirichlet{'xyz'[c]}_bbnd": names[c] for c in range(3) if names[c]}
    displacements = ngsolve.VectorH1(mesh, order=degree, **given)
    moments = ngsolve.HDivDivSurface(mesh, order=degree - 1, discontinuous=True)
    turns = ngsolve.NormalFacetSurface(mesh, order=degree - 1, dirichlet_bbnd="|".join(sorted(still)))
    space = displacements * moments * turns
    if shear:
        space = space * ngsolve.HCurl(mesh, order=degree - 1, dirichlet_bbnd="|".join(sorted(hard)))
    form = _form(space, mesh, degree, deck, float(material.youngs_modulus), float(material.thickness))
    free = space.FreeDofs(True)
    count, scalars = int(sum(space.FreeDofs())), curved.scalars.ndof
    load = form.mat.CreateRowVector()
    load[:] = 0.0
    load.FV().NumPy()[: 3 * scalars] = curved.loads().T.ravel()
    for v, c in np.argwhere(corners.held[:, :3]):  # pins, too; at a corner one shape function alone is not zero
        free.Clear(int(c * scalars + v))
    condensed = load.CreateVector()
    condensed.data = load + form.harmonic_extension_trans * load
    try:
        inverse = form.mat.Inverse(free, inverse="sparsecholesky")
    except Exception as error:  # NGSolve has a class of its own for them, and names it nowhere
        raise SolveFailure(f"NGSolve stopped: {str(error).strip().splitlines()[0]}") from None
    result = load.CreateVector()
    result.data = inverse * condensed
    left, change = condensed.CreateVector(), load.CreateVector()
    for _ in range(REFINEMENTS):
        left.data = condensed - form.mat * result
        change.data = inverse * left
        result.data += change
    gap = change.Norm() / max(result.Norm(), np.finfo(float).tiny)
    if not gap <= STILL:
        raise SolveFailure(f"NGSolve's solution still changes by {gap:.1e} of itself as its equations are refined")
    result.data += form.harmonic_extension * result
    result.data += form.inner_solve * load
    values = result.FV().NumPy()[: 3 * scalars].reshape(3, scalars).T
    return curved.at_nodes(values, deck), count


def _form(space: Any, mesh: Any, degree: int, deck: Deck, youngs: float, h: float) -> Any:
    """Return the assembled form; inner unknowns are eliminated element by element."""
    nu, factor = deck.poissons_ratio, float(deck.part.case.isotropic.bending_factor)
    normal, tangent = specialcf.normal(3), specialcf.tangential(3)
    conormal = ngsolve.Cross(normal, tangent)
    project = Id(3) - OuterProduct(normal, normal)
    tried, tested = space.TnT()
    (u, du), (m, dm), (a, da) = ((t, d) for t, d in zip(tried[:3], tested[:3], strict=True))
    m, dm, a, da = m.Trace(), dm.Trace(), a.Trace(), da.Trace()
    regge = ngsolve.HCurlCurl(mesh, order=degree - 1, discontinuous=True)

    def strain(v: Any) -> Any:
        return Interpolate(Sym(project * Grad(v).Trace()), regge)

    def hessian(v: Any) -> Any:
        return (v.Operator("hesseboundary").trans * normal).Reshape((3, 3))

    def stress(e: Any) -> Any:
        return youngs / (1 - nu**2) * ((1 - nu) * e + nu * Trace(e) * project)

    def compliance(s: Any) -> Any:
        return (1 + nu) / youngs * (s - nu / (nu + 1) * Trace(s) * project)

    bend, dbend = hessian(u), hessian(du)
    turn, dturn = Grad(u).Trace()[normal, conormal], Grad(du).Trace()[normal, conormal]
    form = ngsolve.BilinearForm(space, symmetric=True, condense=True)
    if len(tried) > 3:
        g, dg = tried[3].Trace(), tested[3].Trace()
        bend, dbend, turn, dturn = bend - Grad(g), dbend - Grad(dg), turn - g * conormal, dturn - dg * conormal
        form += h * SHEAR_FACTOR * youngs / (2 * (1 + nu)) * g * dg * ds
    form += h * InnerProduct(stress(strain(u)), strain(du)) * ds
    form += -12 / (factor * h**3) * InnerProduct(compliance(m), dm) * ds
    form += (InnerProduct(dm, bend) + InnerProduct(m, dbend)) * ds
    sides = -m[conormal, conormal] * (dturn - da * conormal) - dm[conormal, conormal] * (turn - a * conormal)
    form += sides * ds(element_boundary=True)
    form.Assemble()
    return form
