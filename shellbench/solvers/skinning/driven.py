"""Bones: places of vertices of the simulated mesh, or ends of rope chains on a motion that was not seen.

The chains are those of `solvers.rope` in its corrected form (`rope-exact`), with weak springs between them and dampers
along them. They hang from the held row of bones, collide with the body's capsules, and start from the cape at rest. A
chain's links are as long as the pattern between its bones. All bones have equal shares of the cape's mass, and its air
drag.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problems.skinning.body import TINY, Capsule, segments
from shellbench.problems.skinning.cape import GRAVITY, Cape
from shellbench.problems.skinning.case import Bones, Ropes, SkinningCase
from shellbench.problems.skinning.data import MAKERS, Clips, kept_at, kept_or_made, simulated_clips
from shellbench.problems.skinning.motion import RATE, BodyMotion, coordinates, rotations
from shellbench.solvers.rope import contact, placing, pulls, stepping
from shellbench.solvers.rope.solver import RopeSettings, scheme_of
from shellbench.solvers.rope.stepping import Chains, Moving, Stepper

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
EARLY = 1e-4  # s: differences in time by which roots get velocities and accelerations
PUSHES = 2  # out of capsules that overlap
FAR = 1e3  # m from the body: ropes that are there have diverged


def bone_grid(case: SkinningCase, meshes: Array) -> Array:
    """Return the places of the bones, (n, nodes, chains, 3), m, in meshes (n, rows, columns, 3)."""
    rows, columns = case.grid
    return np.asarray(meshes[:, rows[:, None], columns])


def bone_places(case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return the places of the bones, (n, nodes, chains, 3), m, that a solver is given of numbered frames."""
    found = bone_grid(case, clips.meshes[frames])
    if case.ropes is not None and (held := np.isin(frames, case.held_out)).any():
        ropes = driven(case.cape, case.body, case.margin, case.bones, case.ropes, case.held_clips)
        found[held] = ropes[np.searchsorted(case.held_out, frames[held])]
    return found


@lru_cache(maxsize=4)
def driven(
    cape: Cape, body: tuple[Capsule, ...], margin: float, bones: Bones, ropes: Ropes, held: tuple[int, ...]
) -> Array:
    """Return the bones of clips by ropes, (clips * frames, nodes, chains, 3), m, in the frame of the neck.

    They are kept beside the clips: see `problems.skinning.data`.
    """
    told = {"bones": bones.model_dump(), "ropes": ropes.model_dump(), "held": held}
    shape = len(held) * cape.frames, bones.nodes, bones.chains, 3
    path = kept_at(cape, body, margin, told, (*MAKERS, stepping, contact, pulls, placing, sys.modules[__name__]))
    found = kept_or_made(path, {"bones": shape}, lambda: {"bones": _driven(cape, body, margin, bones, ropes, held)})
    return found["bones"]


def _driven(
    cape: Cape, body: tuple[Capsule, ...], margin: float, bones: Bones, ropes: Ropes, held: tuple[int, ...]
) -> Array:
    rows, columns = bones.on(cape)
    rest, pattern = simulated_clips(cape, body, margin).rest[rows[:, None], columns], cape.rest()
    steps = np.linalg.norm(np.diff(pattern[:, columns], axis=0), axis=-1)
    lengths = np.add.reduceat(steps, rows[:-1], axis=0)
    apart = np.linalg.norm(np.roll(rest, -1, axis=1) - rest, axis=-1)
    masses = np.full(lengths.shape, cape.mass / rest[..., 0].size)
    chains = Chains(
        lengths, masses, -float(GRAVITY[2]), lambda _: (rest[0],) * 3, cape.air * float(masses[0, 0]), np.zeros(3),
        damping=ropes.damping, stiffness=ropes.lateral,
        rest=apart[1:] if cape.closed else apart[1:, :-1],
    )  # fmt: skip
    collar, rate = pattern[0, columns], ropes.steps_per_second
    return np.concatenate([_followed(cape, body, margin, chains, collar, rest, rate, clip) for clip in held])


def _followed(
    cape: Cape, body: tuple[Capsule, ...], margin: float, chains: Chains, collar: Array, rest: Array, rate: float,
    clip: int,
) -> Array:  # fmt: skip
    """Return the bones of a clip, (frames, nodes, chains, 3), m, in the frame of the neck.

    Raises
    ------
    SolveFailure
        If the ropes diverge.
    """
    parts = max(1, round(rate / RATE))
    step = 1 / (RATE * parts)
    times = np.arange((cape.frames - 1) * parts + 1, dtype=float) * step

    def poses(at: Array) -> BodyMotion:
        return BodyMotion.of(coordinates(cape.seed, clip, at, cape.drift)[None])

    now, before, after = (poses(times + shift) for shift in (0.0, -EARLY, EARLY))
    roots, past, ahead = (collar @ p.rotations[0].swapaxes(1, 2) + p.places[0][:, None] for p in (now, before, after))
    moves = roots, (ahead - past) / (2 * EARLY), (ahead - 2 * roots + past) / EARLY**2
    axes = frames_of(body, now)
    radii = np.array([part.radius for part in body]) + margin
    scheme = scheme_of(RopeSettings(push="gradient", pushes=PUSHES), printed=False)

    def root(time: float) -> tuple[Array, Array, Array]:
        number = round(time / step)
        return moves[0][number], moves[1][number], moves[2][number]

    moving = Moving(0.0, rest[1:], np.zeros_like(rest[1:]))
    found = np.empty((cape.frames, *rest.shape))
    for number in range(len(times)):
        if number % parts == 0:
            nodes = np.concatenate([roots[number][None], moving.places]) - now.places[0, number]
            found[number // parts] = nodes @ now.rotations[0, number]
        if number + 1 < len(times):
            earlier, later = (tuple(each[n] for each in axes) for n in (number, number + 1))
            obstacle = TurningBody(radii, earlier, later, step)
            taken = Stepper(replace(chains, root=root, obstacles=(obstacle,)), scheme, step).next_state(moving)
            if not np.all(np.abs(taken.places - now.places[0, number]) < FAR):
                raise SolveFailure(f"the ropes diverge at t = {times[number]:g} s of clip {clip}")
            moving = Moving(float(times[number + 1]), taken.places, taken.velocities)
    return found


def frames_of(body: tuple[Capsule, ...], motion: BodyMotion) -> tuple[Array, Array, Array]:
    """Return axes (n, c, 2, 3), m, first ends (n, c, 3), m, and rotations (n, c, 3, 3) of the capsules in the world."""
    turn, place = motion.rotations[0], motion.places[0]
    axes = np.einsum("nij,ncej->ncei", turn, segments(body, motion.stride[0])) + place[:, None, None]
    swung = np.stack([-part.swings * part.stride * motion.stride[0] for part in body], axis=1)
    about_x = rotations(np.stack([swung, 0.0 * swung, 0.0 * swung], axis=-1))
    return axes, axes[:, :, 0], turn[:, None] @ about_x


@dataclass(frozen=True)
class TurningBody:
    """The capsules during one step, as an obstacle of ropes; places are in the world.

    Attributes
    ----------
    radii
        (c,), m.
    before, now
        Axes (c, 2, 3), first ends (c, 3), m, and rotations (c, 3, 3) before and after the step.
    """

    radii: Array
    before: tuple[Array, ...]
    now: tuple[Array, ...]
    step: float
    friction: float = 0.0

    def at(self, time: float) -> tuple[Array, Array]:
        """Return the origin: places are those of the world."""
        return np.zeros(3), np.zeros(3)

    def distance(self, places: Array) -> Array:
        """Return the signed distance (...), m."""
        return _nearest(places.reshape(-1, 3), self.now[0], self.radii)[0].reshape(places.shape[:-1])

    def gradient(self, places: Array) -> Array:
        """Return the direction away from the nearest capsule's axis, (..., 3)."""
        return _nearest(places.reshape(-1, 3), self.now[0], self.radii)[2].reshape(places.shape)

    def carried(self, places: Array, earlier: float, time: float) -> Array:
        """Return places (n, 3) before the step as they are after it if they moved with the nearest capsule."""
        return _carried(places, self.before, self.now, self.radii)

    def velocity(self, places: Array, time: float) -> Array:
        """Return the mean velocity (n, 3), m/s, over the step of the nearest capsule's points that end there."""
        return (places - _carried(places, self.now, self.before, self.radii)) / self.step


def _nearest(places: Array, axes: Array, radii: Array) -> tuple[Array, Numbers, Array]:
    """Return distance (n,), m, number (n,) and direction from the axis (n, 3) of the capsule nearest to each place."""
    start, along = axes[:, None, 0], axes[:, 1] - axes[:, 0]
    apart = places - start
    share = np.clip(np.einsum("cnk,ck->cn", apart, along) / np.einsum("ck,ck->c", along, along)[:, None], 0.0, 1.0)
    apart -= share[..., None] * along[:, None]
    lengths = np.sqrt(np.einsum("cnk,cnk->cn", apart, apart))
    phi, number = lengths - radii[:, None], np.arange(len(places))
    nearest = phi.argmin(axis=0)
    ways = apart[nearest, number] / np.maximum(lengths[nearest, number], TINY)[:, None]
    return phi[nearest, number], nearest, ways


def _carried(places: Array, of: tuple[Array, ...], to: tuple[Array, ...], radii: Array) -> Array:
    """Return places (n, 3) moved as the capsules are from one pose to another, each with the nearest one."""
    nearest = _nearest(places, of[0], radii)[1]
    arms = np.einsum("nji,nj->ni", of[2][nearest], places - of[1][nearest])
    return np.asarray(to[1][nearest] + np.einsum("nij,nj->ni", to[2][nearest], arms))
