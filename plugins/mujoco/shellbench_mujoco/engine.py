"""MuJoCo as an engine: the installed version, and the refusal of any other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version

from pydantic import Field, field_validator

from shellbench.errors import InputError
from shellbench.problem import Settings
from shellbench.protocol.engine import engine_version, need

DISTRIBUTION = "mujoco"
# major version; until 3.x the stiffness of flexes was not that of their Young's modulus (change log of 4.0.0)
OLDEST = 4

need("", (DISTRIBUTION,), "./plugins/mujoco")  # without it there is no solver to declare
if int(version(DISTRIBUTION).split(".")[0]) < OLDEST:
    raise InputError(
        f"{DISTRIBUTION} {version(DISTRIBUTION)} is too old, its cloth has other elastic constants:"
        f" python -m pip install '{DISTRIBUTION}>={OLDEST}'"
    )


def _installed() -> str:
    return str(engine_version(DISTRIBUTION))


class EngineSettings(Settings):
    """Settings of a solver on MuJoCo."""

    engine: str = Field(default_factory=_installed, description="name and version of the engine; not to be chosen")

    @field_validator("engine")
    @classmethod
    def _engine_is_installed(cls, engine: str) -> str:
        if engine != _installed():
            raise ValueError(f"{_installed()} is installed, and no other can be asked for")
        return engine


@contextmanager
def quiet() -> Iterator[None]:
    """Keep the engine from writing its warnings to a file; its data still count them."""
    import mujoco

    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(None)
