"""Common settings of the solvers on Kratos; only the solving modules import Kratos itself (`engine`)."""

from __future__ import annotations

from pydantic import Field, field_validator

from shellbench.problem import Settings
from shellbench.protocol.engine import engine_version, need

PLUGIN = "./plugins/kratos"
DISTRIBUTION = "KratosMultiphysics"
APPLICATIONS = ("StructuralMechanicsApplication", "IgaApplication", "LinearSolversApplication")

need("", (DISTRIBUTION, *(f"Kratos{name}" for name in APPLICATIONS)), PLUGIN)  # else there is no solver


def installed() -> str:
    """Return name and version of the engine, such as "KratosMultiphysics 10.4.4"."""
    found = engine_version(DISTRIBUTION)
    assert found is not None  # it was needed above
    return found


class KratosSettings(Settings):
    """Common settings of all solvers on Kratos."""

    engine: str = Field(default_factory=installed, description="the engine and its version; the installed one")

    @field_validator("engine")
    @classmethod
    def _is_the_installed_one(cls, value: str) -> str:
        if value != installed():
            raise ValueError(f"the engine that is installed is '{installed()}', not '{value}'")
        return value
