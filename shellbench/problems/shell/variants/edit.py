"""Edited shells: the test that one shell is an edit of another, and the shells between them.

An edit changes the material, the loads, and the motions of supports. The surface, the held places and components, and
the theory stay.
"""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case

MEASURES = ("vector", "value", "force", "acceleration")  # fields of loads that give their strength
AMOUNTS = ("x", "y", "z", "vector", "angle")  # fields of motions that give their size
SHARED = ("theory", "surface", "remove_rigid_motions", "springs", "path", "dynamics")


def why_no_edit(original: Case, edited: Case) -> str | None:
    """Return a difference of two shells that no edit makes, as one clause, or None if one is an edit of the other."""
    for name in SHARED:
        if getattr(original, name) != getattr(edited, name):
            return f"it has another '{name}' than '{edited.name}'"
    if "orthotropic" in (original.material.kind, edited.material.kind) and original.material != edited.material:
        return f"it has another orthotropic material than '{edited.name}', and edits change isotropic ones"
    if _supports_without_motion(original) != _supports_without_motion(edited):
        return f"its supports hold something else than those of '{edited.name}'"
    return None


def between(original: Case, edited: Case, share: float) -> Case:
    """Return the shell at a share from 0 to 1 of the way from one shell to its edit, with the edit's quantities.

    Thickness and modulus are interpolated by their logarithm, Poisson's ratios and motions linearly. The loads of the
    first shell fade out while those of the other fade in.

    Raises
    ------
    InputError
        If there is no such shell: motions of supports are of different kinds, or a formula grows too long.
    """
    if share == 1.0:
        return edited
    old, new = (case.model_dump(mode="json", exclude_unset=True) for case in (original, edited))
    material = dict(new["material"])
    for name, value in material.items():
        before = getattr(original.material, name)
        if isinstance(value, float | int) and isinstance(before, float | int) and before != value:
            by_logarithm = name in ("thickness", "youngs_modulus")
            mean = before ** (1 - share) * value**share if by_logarithm else (1 - share) * before + share * value
            material[name] = mean
    supports = []
    for support, before, moved in zip(new.get("supports", []), original.supports, edited.supports, strict=True):
        # A support at rest counts as moving by zero, with the kind of motion of the other shell.
        ways = [(before.motion, 1 - share), (moved.motion, share)]
        known = [(motion.model_dump(mode="json"), part) for motion, part in ways if motion is not None]
        supports.append({**support, **({"motion": _motion(known)} if known else {})})
    loads = [_scaled(load, 1 - share, MEASURES) for load in old.get("loads", [])]
    loads += [_scaled(load, share, MEASURES) for load in new.get("loads", [])]
    try:
        return Case.model_validate({**new, "material": material, "supports": supports, "loads": loads})
    except ValidationError as error:
        raise InputError(
            f"no shell between '{original.name}' and '{edited.name}': {error.errors()[0]['msg']}"
        ) from None


def _supports_without_motion(case: Case) -> list[dict[str, Any]]:
    return [support.model_dump(exclude={"motion"}) for support in case.supports]


def _scaled(data: dict[str, Any], share: float, names: tuple[str, ...]) -> dict[str, Any]:
    return {key: _scaled_formula(value, share) if key in names else value for key, value in data.items()}


def _scaled_formula(value: Any, share: float) -> Any:
    if isinstance(value, list):
        return [_scaled_formula(one, share) for one in value]
    return f"{share!r}*({value})" if isinstance(value, str) else share * value


def _motion(parts: list[tuple[dict[str, Any], float]]) -> dict[str, Any]:
    (first, share), *rest = parts
    total = _scaled(first, share, AMOUNTS)
    for other, part in rest:
        if {k: v for k, v in other.items() if k not in AMOUNTS} != {k: v for k, v in first.items() if k not in AMOUNTS}:
            raise InputError("a support moves in another way: a path from the one to the other is not known")
        added = _scaled(other, part, AMOUNTS)
        total = {key: _sum_of_formulas(value, added[key]) if key in AMOUNTS else value for key, value in total.items()}
    return total


def _sum_of_formulas(one: Any, other: Any) -> Any:
    if isinstance(one, list):
        return [_sum_of_formulas(a, b) for a, b in zip(one, other, strict=True)]
    return f"({one})+({other})" if isinstance(one, str) or isinstance(other, str) else one + other
