"""Checks of mechanics: invariances of physics, and agreement of an answer's own values.

Physics does not depend on units or on the placement in space, and the answer of a linear case is proportional to its
loads. Energies and strains agree with each other, and with the displacement.

Strains are computed from differences of the displacement, independently of all solvers.

eps = (a - abar)/2 and kappa = bbar - b (Kairanda et al. 2023, eqs. (15) and (16)) of the deformed surface x + u, the
derivatives of u by central differences. In linear theory they are the part of first order in u, by the same
formulas: (eps(x + s u) - eps(x - s u)) / (2 s) with a small s.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import load_density
from shellbench.problems.shell.question.directions import in_space
from shellbench.problems.shell.question.loads import EdgeLoad, MomentLoad, PointLoad
from shellbench.problems.shell.question.orthotropic import OrthotropicMaterial
from shellbench.problems.shell.question.places import Edge, Point
from shellbench.problems.shell.question.surface import COORDINATES
from shellbench.problems.shell.variants.placing import turning
from shellbench.problems.shell.variants.units import MILLIMETRES_KILONEWTONS, converted_points
from shellbench.problems.shell.variants.variants import SHIFT, size
from shellbench.testing.examination import (
    MOST_EXCUSED,
    OWN,
    Examination,
    Findings,
    Verdict,
    allowed_deviation,
    deviation,
    grid,
    known_energy,
    not_applicable,
    not_shown,
    own_uncertainty,
    scattered,
    why_no_energies,
)
from shellbench.testing.made_cases import FALL, SHORT, amplified, relocated, rescaled, rotated, shifted, short_motion
from shellbench.testing.subject import RemoteSolution

TOGETHER = 1e-6  # largest difference between points of a falling body, relative to its fall
UNSTRETCHED, UNBENT = 1e-6, 1e-2  # relative to energies of the same displacement: wrong formulas give 1
Array = NDArray[np.float64]
Derivatives = dict[tuple[int, int], Array]
PAIRS = ((0, 0), (1, 1), (0, 1))  # of the components 11, 22, 12
SMALL = 1e-4  # strain of the scaled displacement, whose part of third order is then 1e-8 of it
PANELS, OTHER_PANELS, RULE = 48, 37, 4  # panels a side of two rules without common lines: they estimate the error
SAME = 1e-6  # relative difference that counts as zero
MISSED = 3.0  # largest error of an integral, as a multiple of the difference of the two rules
WORK = 0.01  # largest relative difference between the work of loads on a coarse mesh and of exact loads
POINTS = 200  # random points at which strains are compared
MARGIN = 0.02  # their distance from the edges, relative to the side
MUST_AGREE = 0.9  # share of the points that must agree: at others a difference may cross a line of the mesh
STRETCH_STEPS, BEND_STEPS = (1e-5, 1e-4), (1e-3, 1e-2)  # of the side: for first and for second differences
CLOSE, CLOSER = 0.05, 0.01  # largest errors of bending and membrane strains, relative to the largest strain
UNSTRAINED = 1e-8  # of the displacement over the size: smaller differences of a rigid motion are rounding
EDGE_POINTS = 64  # of the rule along an edge


def units(exam: Examination, case: Case) -> Verdict:
    """Check that the case in other units has the same physical displacement."""
    other = rescaled(case, MILLIMETRES_KILONEWTONS)
    if reason := exam.declined(other):
        return not_applicable(f"it declines the case in {MILLIMETRES_KILONEWTONS.words}: {reason}")
    points, limit = grid(case), allowed_deviation(exam, case)
    u = (
        exam.solve(other).displacement(converted_points(case, MILLIMETRES_KILONEWTONS, points))
        / MILLIMETRES_KILONEWTONS.length
    )
    return _same(exam, case, u, limit, f"in {MILLIMETRES_KILONEWTONS.words}")


def linearity(exam: Examination, case: Case) -> Verdict:
    """Check that in linear theory twice the load gives twice the answer."""
    if not case.linear:
        return not_applicable("the case is not linear")
    twice = amplified(case, 2.0)
    if reason := exam.declined(twice):
        return not_applicable(f"it declines the case with twice the load: {reason}")
    limit = allowed_deviation(exam, case)
    return _same(exam, case, exam.solve(twice).displacement(grid(case)) / 2, limit, "half the answer to twice the load")


def placement(exam: Examination, case: Case) -> Verdict:
    """Check that the case turned and shifted in space has the turned displacement.

    A solver of plane shells only, which declines this case, gets the case moved along its plane.
    """
    rotation, shift = turning(case), [part * size(case) for part in SHIFT]
    other = relocated(case, rotation, shift)
    if reason := exam.declined(other):
        along = shifted(case, shift[:2])
        if along is None or exam.declined(along):
            return not_applicable(f"it declines the turned case: {reason}")
        u = exam.solve(along).displacement(grid(along))
        return _same(exam, case, u, allowed_deviation(exam, case), "moved along its plane")
    turned = exam.solve(other)
    # A field may lose planes of symmetry by the turn; the less certain answer limits the agreement.
    limit = max(allowed_deviation(exam, case), min(MOST_EXCUSED, OWN * own_uncertainty(turned)))
    return _same(exam, case, turned.displacement(grid(case)) @ np.array(rotation), limit, "turned and shifted")


def _same(exam: Examination, case: Case, displacement: np.ndarray, limit: float, words: str) -> Verdict:
    found = Findings()
    difference = deviation(displacement, exam.solve(case).displacement(grid(case)))
    found.hold(
        difference <= limit,
        f"{words}, it differs by {difference:.1e} of the largest displacement; at most {limit:.1e} may be",
        f"{words}: {difference:.1e} (at most {limit:.1e})",
    )
    return found.verdict()


def rigid_motion(exam: Examination, case: Case) -> Verdict:
    """Check that a shell that its supports carry, or that falls freely, moves as a rigid body without strains."""
    if case.dynamics is not None:
        return _fall_of_strip(exam)
    moved = rotated(case)
    if moved is None:
        return not_applicable("the case's supports can't carry it as a rigid body")
    if reason := exam.declined(moved):
        return not_applicable(f"it declines the case carried by its supports: {reason}")
    answer, points = exam.solve(moved), grid(moved)
    support, place = next(moved.supported_places())
    expected = moved.motion(support, place, points, moved.states[-1])[0, 0]
    found, difference = Findings(), deviation(answer.displacement(points), expected)
    limit = allowed_deviation(exam, moved)
    found.hold(
        difference <= limit,
        f"it departs from the rigid motion by {difference:.1e} of it; at most {limit:.1e} may be",
        f"departs by {difference:.1e} of the motion",
    )
    _unstrained(found, answer, expected)
    return found.verdict()


def _unstrained(found: Findings, answer: RemoteSolution, u: np.ndarray) -> None:
    """Compare energies with stretching, D u^2 / 2, and bending, B (u / size)^2 / 2, for the same displacement."""
    material, far = answer.case.material, float(np.abs(u).max())
    membrane, bending = answer.energies()
    stretched = abs(membrane) / (material.membrane_stiffness * far**2 / 2)
    bent = abs(bending) / (material.bending_stiffness * (far / size(answer.case)) ** 2 / 2)
    words = (
        f"membrane energy {stretched:.1e} of that of stretching as far, bending energy {bent:.1e} of that of bending"
    )
    found.hold(stretched <= UNSTRETCHED and bent <= UNBENT, f"a rigid motion has {words}", words)


def _fall_of_strip(exam: Examination) -> Verdict:
    """Check that a free strip falls as a rigid body."""
    case = short_motion(FALL)
    if reason := exam.declined(case):
        return not_applicable(f"it declines {FALL}: {reason}")
    answer, found = exam.solve(case), Findings()
    u = answer.displacement(grid(case))
    mean = u.mean(axis=0)
    together = float(np.abs(u - mean).max() / np.linalg.norm(mean))
    found.hold(
        together <= TOGETHER, f"points of what falls differ by {together:.1e}", f"falls as one to {together:.1e}"
    )
    _unstrained(found, answer, u)
    exact = -9.8 * SHORT**2 / 2
    found.figures.append(f"by {-mean[2]:.6g} m, g t^2 / 2 = {-exact:.6g} m")
    return found.verdict()


def differences(field: Callable[[Array], Array], points: Array, steps: Array) -> Derivatives:
    """Return first and second derivatives (n, 3) of a field at points (n, 2) by central differences."""
    one, two = np.array([steps[0], 0.0]), np.array([0.0, steps[1]])
    offsets = [0 * one, one, -one, two, -two, one + two, one - two, two - one, -one - two]
    u = field(np.concatenate([points + o for o in offsets])).reshape(len(offsets), len(points), 3)
    return {
        (1, 0): (u[1] - u[2]) / (2 * steps[0]),
        (0, 1): (u[3] - u[4]) / (2 * steps[1]),
        (2, 0): (u[1] - 2 * u[0] + u[2]) / steps[0] ** 2,
        (0, 2): (u[3] - 2 * u[0] + u[4]) / steps[1] ** 2,
        (1, 1): (u[5] - u[6] - u[7] + u[8]) / (4 * steps[0] * steps[1]),
    }


def fundamental_forms(x: Derivatives) -> tuple[Array, Array]:
    """Return metric and curvature tensor (n, 3) each, components 11, 22, 12, of derivatives of a surface."""
    tangents = (x[1, 0], x[0, 1])
    normal = np.cross(*tangents)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    metric = [np.sum(tangents[i] * tangents[j], axis=-1) for i, j in PAIRS]
    curvature = [np.sum(x[key] * normal, axis=-1) for key in ((2, 0), (0, 2), (1, 1))]
    return np.stack(metric, axis=-1), np.stack(curvature, axis=-1)


def strains(case: Case, points: Array, u: Derivatives) -> tuple[Array, Array]:
    """Return membrane and bending strain (n, 3) of a displacement's derivatives, covariant components 11, 22, 12."""
    x = case.surface.derivatives(points, order=2)

    def moved(factor: float) -> tuple[Array, Array]:
        return fundamental_forms({key: x[key] + factor * u[key] for key in u})

    if not case.linear:
        (a, b), (abar, bbar) = moved(1.0), moved(0.0)
        return (a - abar) / 2, bbar - b
    gradient = max(np.abs(u[1, 0]).max() / np.abs(x[1, 0]).max(), np.abs(u[0, 1]).max() / np.abs(x[0, 1]).max())
    s = SMALL / gradient if gradient > 0 else 1.0
    (a, b), (less_a, less_b) = moved(s), moved(-s)
    return (a - less_a) / (4 * s), (less_b - b) / (2 * s)


def base_lengths(case: Case, points: Array) -> Array:
    """Return (n, 3): products of the base vectors' lengths, by which covariant components become physical ones."""
    x = case.surface.derivatives(points, order=1)
    a1, a2 = np.linalg.norm(x[1, 0], axis=-1), np.linalg.norm(x[0, 1], axis=-1)
    return np.stack([a1 * a1, a2 * a2, a1 * a2], axis=-1)


def energy_densities(case: Case, points: Array, membrane: Array, bending: Array) -> tuple[Array, Array]:
    """Return membrane and bending energy (n,), J/m^2, of strains (n, 3) (Kairanda et al. 2023, eqs. (17)-(19))."""
    material, x = case.material, case.surface.derivatives(points, order=2)
    if isinstance(material, OrthotropicMaterial):
        one, other = (
            np.einsum("pi,ij,pj->p", e, stiffness, e) / 2
            for e, stiffness in zip(
                _in_space(x, material, [membrane, bending]), material.turned_stiffnesses, strict=True
            )
        )
        return one, other
    metric, _ = fundamental_forms(x)
    full = metric[:, [[0, 2], [2, 1]]]
    upper = np.linalg.inv(full)

    def density(stiffness: float, nu: float, strain: Array) -> Array:
        mixed = np.einsum("pab,pbc->pac", upper, strain[:, [[0, 2], [2, 1]]])
        trace = np.trace(mixed, axis1=1, axis2=2)
        squared = np.einsum("pab,pba->p", mixed, mixed)
        return np.asarray(stiffness / 2 * (nu * trace**2 + (1 - nu) * squared))

    nu, nu_of_bending = material.poissons_ratios
    return (
        density(material.membrane_stiffness, nu, membrane),
        density(material.bending_stiffness, nu_of_bending, bending),
    )


def _in_space(x: Derivatives, material: OrthotropicMaterial, strains: list[Array]) -> list[Array]:
    """Return 11, 22 and twice 12 (n, 3) of strains (n, 3) along the line that a material's angle is measured from."""
    base = np.stack([x[1, 0], x[0, 1]], axis=-1)
    line = base[..., COORDINATES.index(material.along)]
    normal = np.cross(base[..., 0], base[..., 1])
    frame = np.stack([line, np.cross(normal, line)], axis=1)
    frame /= np.linalg.norm(frame, axis=-1, keepdims=True)
    dual = np.linalg.inv(frame @ base)  # xi_a,i: the coordinates by the place along the frame
    along = [np.swapaxes(dual, 1, 2) @ strain[:, [[0, 2], [2, 1]]] @ dual for strain in strains]
    return [np.stack([e[:, 0, 0], e[:, 1, 1], 2 * e[:, 0, 1]], axis=-1) for e in along]


def energies(exam: Examination, case: Case) -> Verdict:
    """Check that the energy densities are those of the strains, and add up to the energies."""
    found, answer = Findings(), exam.solve(case)
    points = scattered(case, POINTS, seed=6)
    stated = [answer.field(f"{part}_energy_density", points) for part in ("membrane", "bending")]
    expected = energy_densities(
        case, points, answer.field("membrane_strain", points), answer.field("bending_strain", points)
    )
    scale = max(np.abs(e).max() for e in expected)
    for part, mine, theirs in zip(("membrane", "bending"), expected, stated, strict=True):
        off = float(np.abs(mine - theirs).max() / scale) if scale > 0 else float(np.abs(theirs).max())
        found.hold(
            off <= SAME,
            f"the {part} energy density is not that of the {part} strain: off by {off:.1e} of the largest density",
            f"{part} density off by {off:.1e}",
        )
    total = sum(answer.energies())
    for part, energy in zip(("membrane", "bending"), answer.energies(), strict=True):
        integral, other = (_integral(answer, f"{part}_energy_density", panels) for panels in (PANELS, OTHER_PANELS))
        missed = MISSED * abs(integral - other)
        off = abs(integral - energy)
        found.hold(
            off <= missed + SAME * abs(total),
            f"the {part} energy is {energy:.6g} J; its density adds up to {integral:.6g} J, known to {missed:.1g} J",
            f"{part} energy {energy:.6g} J, integral off by {off / abs(total) if total else off:.1e}",
        )
    return found.verdict()


def gauss_rule(case: Case, panels: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points (n, 2) and weights (n,), m^2: Gauss's rule on equal panels."""
    domain = case.surface.domain
    x, w = np.polynomial.legendre.leggauss(RULE)
    local = ((np.arange(panels)[:, None] + (x + 1) / 2) / panels).ravel()
    weights = np.tile(w / 2 / panels, panels)
    first, second = (low + side * local for low, side in zip(domain.lower, domain.size, strict=True))
    points = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    x_ = case.surface.derivatives(points, order=1)
    area = np.linalg.norm(np.cross(x_[1, 0], x_[0, 1]), axis=-1)
    return points, np.outer(weights, weights).ravel() * np.prod(domain.size) * area


def _integral(answer: RemoteSolution, name: str, panels: int) -> float:
    points, weights = gauss_rule(answer.case, panels)
    return float(weights @ answer.field(name, points))


def work(exam: Examination, case: Case) -> Verdict:
    """Check that in linear theory without moved supports the loads' work is twice the strain energy (Clapeyron)."""
    if not case.linear:
        return not_applicable("the case is not linear")
    if any(s.motion for s in case.supports):
        return not_applicable("supports move, and work")
    if any(isinstance(load, MomentLoad) for load in case.loads):
        return not_applicable("the work of moments is not taken here")
    found, answer = Findings(), exam.solve(case)
    done, lacking = loads_work(answer), why_no_energies(exam, case)
    energy = known_energy(case) if lacking else sum(answer.energies())
    if energy is None:
        return not_shown(f"{lacking}, and no strain energy is known of {case.name}")
    off = abs(2 * energy - done) / abs(done) if done else abs(energy)
    own = OWN * answer.facts["uncertainty"].get("strain_energy", 0.0) / energy if energy and not lacking else 0.0
    limit, whose = min(MOST_EXCUSED, max(WORK, own)), "the known" if lacking else "its"
    found.hold(
        off <= limit,
        f"twice {whose} strain energy is {2 * energy:.6g} J, the loads' work {done:.6g} J: at most {limit:.1e} may be",
        f"twice {whose} strain energy is off the loads' work, {done:.6g} J, by {off:.1e} (at most {limit:.1e})",
    )
    return found.verdict()


def loads_work(answer: RemoteSolution) -> float:
    """Return the work of a linear case's loads on the displacement, J."""
    case, at = answer.case, answer.case.states[-1]
    points, weights = gauss_rule(case, PANELS)
    total = float(weights @ np.sum(load_density(case, points, at) * answer.displacement(points), axis=-1))
    for load in case.loads:
        for place in (case.places[name] for name in load.on) if isinstance(load, PointLoad | EdgeLoad) else ():
            if isinstance(load, PointLoad) and isinstance(place, Point):
                force = case.evaluate(load.force, np.asarray(place.xi), at)[0, 0]
                total += float(force @ answer.displacement(np.asarray(place.xi)))
            elif isinstance(load, EdgeLoad) and isinstance(place, Edge):
                total += _edge_work(answer, load, place, at)
    return total


def _edge_work(answer: RemoteSolution, load: EdgeLoad, edge: Edge, at: float) -> float:
    case, running = answer.case, 1 - edge.axis
    x, w = np.polynomial.legendre.leggauss(EDGE_POINTS)
    domain = case.surface.domain
    start, stop = edge.bounds(domain)
    points = edge.points(domain, start + (stop - start) * (x + 1) / 2)
    tangent = case.surface.derivatives(points, order=1)[(1, 0) if running == 0 else (0, 1)]
    length = w / 2 * (stop - start) * np.linalg.norm(tangent, axis=-1)
    force = case.evaluate(load.vector, points, at)[0, 0]
    if load.frame == "local":
        force = in_space(case.surface, force, points, edge)
    return float(length @ np.sum(force * answer.displacement(points), axis=-1))


def strain_fields(exam: Examination, case: Case) -> Verdict:
    """Check that strains at points are those of the displacement's differences there."""
    found, answer = Findings(), exam.solve(case)
    points, sides = scattered(case, POINTS, seed=7, margin=MARGIN), np.asarray(case.surface.domain.size)
    physical = base_lengths(case, points)
    parts = (("membrane", 1.0, CLOSER, STRETCH_STEPS), ("bending", case.material.thickness / 2, CLOSE, BEND_STEPS))
    felt = {}  # by part: stated strains, and strains from differences with a fine and a coarse step
    for number, (part, factor, _, steps) in enumerate(parts):
        measured = (strains(case, points, differences(answer.displacement, points, s * sides))[number] for s in steps)
        felt[part] = [factor * f / physical for f in (answer.field(f"{part}_strain", points), *measured)]
    # differences across a kink grow as their step shrinks, and must not set the scale
    scale = max(max(np.abs(f[0]).max(), np.median(np.abs(f[1]).max(axis=-1))) for f in felt.values())
    if scale <= UNSTRAINED * np.abs(answer.displacement(points)).max() / size(case):
        found.figures.append("unstrained, and says so")
        return found.verdict()
    for part, _, close, steps in parts:
        theirs, mine, rough = (f / scale for f in felt[part])
        there = (
            np.max(np.abs([theirs, mine, rough]), axis=(0, 2)) > close
        )  # elsewhere all values agree because they are near zero
        off, kinks = (np.abs(mine - other).max(axis=-1)[there] for other in (theirs, rough))
        if not off.size:
            found.figures.append(f"{part} strains are next to nothing, and say so")
            continue
        if np.mean(kinks <= close) < MUST_AGREE:
            found.unseen.append(
                f"{part} strains: the displacement's differences over {steps[0]:g} and {steps[1]:g} of the side"
                f" disagree at {np.mean(kinks > close):.0%} of the points, as where it has kinks"
            )
            continue
        agree = float(np.mean(off <= close))
        found.hold(
            agree >= MUST_AGREE,
            f"{part} strains agree with differences of the displacement at {agree:.0%} of {off.size} points only"
            f" (median {np.median(off):.1e} of the largest strain)",
            f"{part} strains agree at {agree:.0%} of {off.size} points, median {np.median(off):.1e} of the largest",
        )
    return found.verdict()
