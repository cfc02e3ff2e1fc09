"""Checks that a path or a motion begins at rest and can be followed."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.problems.shell.question.conditions import COMPONENTS
from shellbench.problems.shell.question.places import Whole

Array = NDArray[np.float64]

COURSE_SAMPLES = 9  # points a side at which loads and motions are sampled
TIMES, GOLDEN = 32, (5**0.5 - 1) / 2  # further instants, not periodic, so that no periodic formula escapes them
PROPORTIONAL = 1e-12  # relative departure from proportional loads that is rounding
INSTANT = 1e-6  # of the whole time, after which a motion from rest has hardly moved
AT_REST = 1e-3  # of a support's mean velocity: the velocity it may have after that instant


def check_path(case: Shell) -> None:
    """Check that a static case's path starts from rest and is one that solvers can follow.

    Raises
    ------
    ValueError
        In one clause that states the fault.
    """
    path = case.path
    if case.springs and not case.linear:
        raise ValueError("springs belong to the linear theory, or to a case with [dynamics]")
    if case.held_everywhere:
        raise ValueError("a component that is held on the whole surface belongs to a case with [dynamics]")
    if path.quantity is not None:
        named = next((q for q in case.quantities if q.name == path.quantity), None)
        if not isinstance(named, DisplacementQuantity):
            raise ValueError(f"the path names '{path.quantity}', which is no displacement quantity")
        if case.linear:
            raise ValueError(f"a path with control = '{path.control}' belongs to the non-linear theory")
        if any(isinstance(place, Whole) for _, place in case.supported_places()):
            raise ValueError(
                f"where everything is prescribed no path is followed, so that control can't be '{path.control}'"
            )
    for quantity in case.quantities:
        quantity.check_path(case)
    if case.linear:
        return
    beyond = [state for state in case.states if not 0 < state <= path.until]
    if beyond:
        raise ValueError(f"a state is asked for at {beyond[0]:g}, but the path goes from 0 to {path.until:g}")
    sample = case.surface.domain.grid(COURSE_SAMPLES, COURSE_SAMPLES)
    for what, at in (*_moves(case, sample), *_loads(case, sample)):
        rest, unit, twice = at(0.0), at(1.0), at(2.0)
        if np.any(rest != 0):
            raise ValueError(f"{what} acts at t = 0; in the non-linear theory t is the load factor, and rest is at 0")
        for t in np.linspace(0.0, path.until, COURSE_SAMPLES)[1:] if path.quantity is None else ():
            if not np.all(np.isfinite(at(float(t)))):
                raise ValueError(f"{what} is not finite at t = {t:.4g}, on the way to {path.until:g}")
        if path.quantity is not None and np.abs(twice - 2 * unit).max() > PROPORTIONAL * np.abs(unit).max():
            raise ValueError(f"{what} is not proportional to t, as a path with control '{path.control}' needs")


def check_motion(case: Shell) -> None:
    """Check that a case with [dynamics] starts from rest and has all data of its motion.

    Raises
    ------
    ValueError
        In one clause that states the fault.
    """
    assert case.dynamics is not None
    until = case.dynamics.until
    if case.linear:
        raise ValueError("[dynamics] belongs to the theory kirchhoff-love-nonlinear")
    if "path" in case.model_fields_set:
        raise ValueError("a case has a [path] or [dynamics], not both")
    if case.material.areal_density <= 0:
        raise ValueError("field 'material.areal_density' must be given and positive where the shell moves")
    if not case.material.uniform:
        raise ValueError("a modulus or thickness that varies belongs to a case without [dynamics]")
    if case.prescribed:
        raise ValueError("where everything is prescribed nothing is left to move by Newton's law")
    if len(case.held_everywhere) == len(COMPONENTS):
        raise ValueError("all components are held on the whole surface, so that nothing is left to move")
    if case.remove_rigid_motions:
        raise ValueError("in motion no rigid motion is removed: what nothing holds moves")
    beyond = [state for state in case.states if not 0 < state <= until]
    if beyond:
        raise ValueError(
            f"a state is asked for at {beyond[0]:g} s, but the motion starts from rest at 0 s and ends at {until:g} s"
        )
    sample = case.surface.domain.grid(COURSE_SAMPLES, COURSE_SAMPLES)
    times = instants(case)
    for what, at in _moves(case, sample):
        values = [at(float(t)) for t in times]
        if not np.all(np.isfinite(values)):
            raise ValueError(f"{what} is not finite on the way to {until:g} s")
        farthest = np.abs(values).max()
        if np.any(values[0] != 0):
            raise ValueError(f"{what} is not zero at t = 0, where the shell is at rest")
        if np.abs(at(INSTANT * until)).max() > AT_REST * INSTANT * farthest:
            raise ValueError(f"{what} has a velocity at t = 0, where the shell is at rest: ramp it smoothly")
    for what, at in _loads(case, sample):
        if not np.all(np.isfinite([at(float(t)) for t in times])):
            raise ValueError(f"{what} is not finite on the way to {until:g} s")
    constant = is_constant(case)
    for quantity in case.quantities:
        quantity.check_motion(case, constant)


def is_constant(case: Shell) -> bool:
    """Return True if supports stand still and loads do not depend on time."""
    sample = case.surface.domain.grid(COURSE_SAMPLES, COURSE_SAMPLES)
    return case.steady and not any(np.any(at(float(t))) for _, at in _moves(case, sample) for t in instants(case))


def instants(case: Shell) -> Array:
    """Return the instants at which a motion's supports and loads are sampled, s."""
    assert case.dynamics is not None
    shares = np.concatenate([np.linspace(0.0, 1.0, COURSE_SAMPLES), (np.arange(1, TIMES) * GOLDEN) % 1])
    return np.asarray(case.dynamics.until * shares)


Acting = tuple[str, Callable[[float], Array]]


def _moves(case: Shell, sample: Array) -> Iterator[Acting]:
    """Yield the motions of supports as functions of t."""
    for support, place in case.supported_places():
        if isinstance(place, Whole):
            continue  # if everything is prescribed, no path leads there from rest
        yield (
            f"the motion of support '{support.name}'",
            lambda t, s=support, p=place: case.motion(s, p, sample, t)[0, 0],  # type: ignore[misc]
        )


def _loads(case: Shell, sample: Array) -> Iterator[Acting]:
    """Yield the loads as functions of t."""
    for load in case.loads:
        formulas = [case.formula(formula) for formula in load.formulas]
        yield (
            f"a load of kind '{load.kind}'",
            lambda t, fs=formulas: np.stack([f.derivatives(sample, 0, t)[0, 0] for f in fs]),  # type: ignore[misc]
        )
