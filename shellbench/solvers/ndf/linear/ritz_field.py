"""The field that `ndf-ritz` takes for a case and its settings, and the cases that are solved along a path."""

from __future__ import annotations

from dataclasses import replace

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.solvers.ndf.field.build import Resolution
from shellbench.solvers.ndf.field.choices import FieldSpec, StrainName
from shellbench.solvers.ndf.field.jets import activation, smooth_activation
from shellbench.solvers.ndf.linear.ritz_settings import RitzSettings


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
        If another one than the linear is asked for in the linear theory.
    """
    if case.linear and strain not in (None, "linear"):
        raise InputError(f"case '{case.name}' is of the linear theory: setting strain = \"{strain}\" does not fit it")
    return strain or ("linear" if case.linear else "exact")


def with_settings(usual: Resolution, settings: RitzSettings) -> Resolution:
    """Return a resolution with what settings fix."""
    rule = replace(usual.rule, panels=settings.panels or usual.rule.panels, order=settings.order or usual.rule.order)
    return replace(
        usual,
        neurons=settings.neurons or usual.neurons,
        scale=settings.scale or usual.scale,
        rule=rule,
    )


def is_path(case: Case) -> bool:
    """Tell whether a case is solved along a path: in linear theory where all is prescribed, or edge moments act."""
    if not case.linear or any(isinstance(load, MomentLoad) for load in case.loads):
        return True
    return case.prescribed
