"""MuJoCo itself, which comes with an extra: who needs it imports it from here."""

from __future__ import annotations

from importlib.metadata import version

from shellbench.engine import need
from shellbench.errors import InputError

DISTRIBUTION = "mujoco"
OLDEST = (
    4  # major version; until 3.x the stiffness of flexes was not that of their Young's modulus (change log of 4.0.0)
)

need("mujoco", (DISTRIBUTION,))
if int(version(DISTRIBUTION).split(".")[0]) < OLDEST:
    raise InputError(
        f"{DISTRIBUTION} {version(DISTRIBUTION)} is too old, its cloth has other elastic constants:"
        f" python -m pip install '{DISTRIBUTION}>={OLDEST}'"
    )

import mujoco  # noqa: E402

__all__ = ["DISTRIBUTION", "mujoco"]
