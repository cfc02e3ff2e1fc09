"""The field of `ndf-ritz` for a case and its settings, and the cases that are solved along a path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.solvers.ndf.field.build import Resolution, usual_resolution
from shellbench.solvers.ndf.field.choices import FieldSpec, StrainName
from shellbench.solvers.ndf.field.geometry import SURFACE_SAMPLES
from shellbench.solvers.ndf.field.inputs import foci
from shellbench.solvers.ndf.field.jets import activation, smooth_activation
from shellbench.solvers.ndf.field.mirrors import Mirrors
from shellbench.solvers.ndf.linear.refinement import finer_rule, is_slender
from shellbench.solvers.ndf.linear.ritz_settings import RitzSettings

# Where planes of symmetry are built in: a field of p parts has p**-`FEWER` times the features. Slender shells keep all:
# with half of them a strip of 1 : 50 settled 1.5e-6 short of its energy, with all 1e-7. Factors of the scales of plain
# and of stretched inputs, and of the number of points a feature where forces act at points. Chosen by certified energy
# on a hemisphere, pinched cylinders of R / h = 50, 300 and 1000, hyperboloids, plates and roofs.
FEWER, PLAIN_SHARE, STRETCHED_SHARE, MORE_POINTS = 0.5, 0.75, 2.0, 1.5
# Of the speed along a coordinate line. Panels and scales are in coordinates: on pinched cylinders whose coordinates run
# 2.3 times as fast at one place as at another, such features exploit the rule; those that run evenly have 1 to 1.3.
UNEVEN = 2.0
CHALLENGED = 2.0  # times as many challengers as elsewhere: such fields gain ever less (see `challenge.MIRRORED_SHARE`)


def field_spec(case: Case, settings: RitzSettings) -> FieldSpec:
    """Return the choices of the field; InputError if settings do not fit each other or the case."""
    if settings.penalty and settings.supports == "hard":
        raise InputError("setting penalty belongs to supports = \"soft\"; here they are 'hard'")
    if case.dynamics is None and (settings.degrees or settings.hidden == "placed"):
        raise InputError(f"{case.name} stands still: settings degrees and hidden belong to motions")
    if settings.degrees and settings.neurons:
        raise InputError("setting neurons says of which degree a motion is; it does not go with degrees")
    if settings.hidden == "placed" and settings.activation != "sine":
        raise InputError(f"setting hidden = \"placed\" places sines, but found activation = '{settings.activation}'")
    path = case.dynamics is not None or is_path(case)
    (smooth_activation if path else activation)(settings.activation)
    return FieldSpec(
        activation=settings.activation,
        periodic_input=settings.periodic_input,
        components=settings.components,
        supports=settings.supports,
        # The rows are those of small turns.
        slopes="rows" if case.linear and case.dynamics is None else "even",
        stretched=settings.stretched,
        layer=settings.layer,
        edge_stretched=settings.stretched,
        multipliers=settings.singular,
        strain=strain_of(case, settings.strain),
    )


def strain_of(case: Case, strain: StrainName | None) -> StrainName:
    """Return the strain measure of a case.

    Raises
    ------
    InputError
        If the linear theory is combined with another strain measure.
    """
    if case.linear and strain not in (None, "linear"):
        raise InputError(f"case '{case.name}' is of the linear theory: setting strain = \"{strain}\" does not fit it")
    return strain or ("linear" if case.linear else "exact")


def mirrors_by_default(case: Case) -> bool:
    """Return True if planes of symmetry are built in by default: not with point forces on uneven coordinates."""
    x = case.surface.derivatives(case.surface.domain.grid(SURFACE_SAMPLES, SURFACE_SAMPLES), 1)
    speeds = [np.linalg.norm(d, axis=-1) for d in (x[1, 0], x[0, 1])]
    return not foci(case) or all(bool((s.max(k) <= UNEVEN * s.min(k)).all()) for k, s in enumerate(speeds))


def part_resolution(case: Case, mirrors: Mirrors | None) -> Resolution:
    """Return the default resolution of a case with these planes of symmetry built in: on one part, or the whole."""
    usual = usual_resolution(case)
    if mirrors is None:
        return usual
    neurons = usual.neurons if is_slender(case) else round(usual.neurons * mirrors.parts**-FEWER)
    growth = math.sqrt(mirrors.parts * neurons / usual.neurons * (MORE_POINTS if foci(case) else 1.0))
    return replace(
        usual,
        neurons=neurons,
        scale=PLAIN_SHARE * usual.scale,
        stretched_scale=STRETCHED_SHARE * usual.stretched_scale,
        share=CHALLENGED * usual.share,
        rule=finer_rule(usual.rule, growth),
        fine=finer_rule(usual.fine, growth),
    )


def with_settings(usual: Resolution, settings: RitzSettings) -> Resolution:
    """Return a resolution with the values that settings fix."""
    rule = replace(usual.rule, panels=settings.panels or usual.rule.panels, order=settings.order or usual.rule.order)
    return replace(
        usual,
        neurons=settings.neurons or usual.neurons,
        scale=settings.scale or usual.scale,
        rule=rule,
    )


def is_path(case: Case) -> bool:
    """Return True if a case is solved along a path; linear ones are if all is prescribed, or edge moments act."""
    if not case.linear or any(isinstance(load, MomentLoad) for load in case.loads):
        return True
    return case.prescribed
