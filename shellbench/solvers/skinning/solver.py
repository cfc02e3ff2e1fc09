"""The solvers of capes; the modules that fit and train are imported when they are called."""

from __future__ import annotations

import time
from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shellbench.problem import Capabilities, ProgressCallback, Settings, Step
from shellbench.problems.skinning.case import SkinningCase
from shellbench.problems.solving import FreshSolver
from shellbench.solvers.skinning.settings import (
    BlendSettings,
    ChainSettings,
    FloorSettings,
    NetworkSettings,
    QuasistaticSettings,
    RecurrentSettings,
    RidgeSettings,
    ShapeSettings,
)

if TYPE_CHECKING:
    from shellbench.solvers.skinning.solution import Skin, Skinned

THEORIES = ("skinning",)


class SkinningSolver(FreshSolver):
    """A solver of capes. A subclass gives `answer` and `skin`."""

    def declines(self, case: Any) -> str | None:
        """Return the reason that it declines a problem, or None: it takes every case of kind 'skinning'."""
        return None if isinstance(case, SkinningCase) else "it solves problems of kind 'skinning' only"

    @abstractmethod
    def skin(self) -> Skin:
        """Return the function that computes meshes from the fitted arrays."""

    def load(self, path: Path) -> Skinned:
        """Read a file of this solver; InputError in one sentence if it is no such file."""
        from shellbench.solvers.skinning.solution import Skinned

        return Skinned.load(path, self.name, self.skin())

    def fitted(self, case: SkinningCase, arrays: Any, began: float, **told: Any) -> Skinned:
        """Return the solution of arrays that were fitted in one step since a time of `time.perf_counter`, s."""
        from shellbench.solvers.skinning.solution import Skinned

        seconds = time.perf_counter() - began
        made = Skinned(case, self.name, self.skin(), arrays, diagnostics=told)
        return Skinned(case, self.name, made.skin, arrays, (Step(0, seconds, 0.0, made.parameters),), made.diagnostics)


class FloorSolver(SkinningSolver):
    """Lower bound of the error of any skinning by the same modes."""

    name = "skin-floor"
    capabilities = Capabilities(
        THEORIES, "PCA floor: held-out frames themselves, projected onto modes; no method, for it sees the answer"
    )
    settings_type = FloorSettings

    def answer(self, case: SkinningCase, settings: FloorSettings, progress: ProgressCallback) -> Skinned:
        """Take the modes of the frames that are seen, or of those that are held out."""
        from shellbench.problems.skinning.data import clips_of
        from shellbench.solvers.skinning.linear import modes_of

        clips, began = clips_of(case), time.perf_counter()
        frames = case.seen if settings.of == "seen" else case.held_out
        return self.fitted(case, modes_of(clips.moved[frames], settings.modes), began)

    def skin(self) -> Skin:
        """Return the function that computes meshes from modes."""
        from shellbench.solvers.skinning.linear import floor_skin

        return floor_skin


class BilinearSolver(SkinningSolver):
    """Interpolation, without a fit."""

    name = "skin-bilinear"
    capabilities = Capabilities(THEORIES, "bones' displacements, interpolated bilinearly over the mesh; nothing fitted")

    def answer(self, case: SkinningCase, settings: Settings, progress: ProgressCallback) -> Skinned:
        """Fit nothing."""
        return self.fitted(case, {}, time.perf_counter())

    def skin(self) -> Skin:
        """Return the function that interpolates meshes."""
        from shellbench.solvers.skinning.linear import bilinear_skin

        return bilinear_skin


class BlendSolver(SkinningSolver):
    """Linear blend skinning (Magnenat-Thalmann et al. 1988)."""

    name = "skin-blend"
    capabilities = Capabilities(
        THEORIES, "linear blend skinning: rigid bones that turn with their chain, fitted weights"
    )
    settings_type = BlendSettings

    def answer(self, case: SkinningCase, settings: BlendSettings, progress: ProgressCallback) -> Skinned:
        """Fit the weights."""
        from shellbench.problems.skinning.data import clips_of
        from shellbench.solvers.skinning.linear import blend_fit

        clips, began = clips_of(case), time.perf_counter()
        count = min(settings.near, case.bones.chains * case.bones.nodes)
        return self.fitted(case, blend_fit(case, clips, count), began)

    def skin(self) -> Skin:
        """Return the function by which vertices follow bones."""
        from shellbench.solvers.skinning.linear import blend_skin

        return blend_skin


class RidgeSolver(SkinningSolver):
    """A linear map from bones to coefficients of PCA modes, in place of the paper's network."""

    name = "skin-ridge"
    capabilities = Capabilities(
        THEORIES, "ridge regression from bones to PCA coefficients, penalty by cross validation"
    )
    settings_type = RidgeSettings

    def answer(self, case: SkinningCase, settings: RidgeSettings, progress: ProgressCallback) -> Skinned:
        """Fit the map."""
        from shellbench.problems.skinning.data import clips_of
        from shellbench.solvers.skinning.linear import bones, coefficients, modes_of, ridge_fit

        clips, began = clips_of(case), time.perf_counter()
        moved = clips.moved[case.seen]
        basis = modes_of(moved, settings.modes)
        given, wanted = bones(case, clips, case.seen), coefficients(basis, moved)
        found, penalty = ridge_fit(given, wanted, case.groups, settings.penalty)
        return self.fitted(case, basis | found, began, penalty=penalty)

    def skin(self) -> Skin:
        """Return the function that maps bones to meshes."""
        from shellbench.solvers.skinning.linear import ridge_skin

        return ridge_skin


class NetworkSolver(SkinningSolver):
    """The paper's neural skinning."""

    name = "skin-network"
    capabilities = Capabilities(
        THEORIES,
        "neural skinning of Jin et al.: perceptron 2 x 500 from bones to PCA coefficients, with collision loss",
    )
    settings_type = NetworkSettings

    def answer(self, case: SkinningCase, settings: NetworkSettings, progress: ProgressCallback) -> Skinned:
        """Train from bones."""
        from shellbench.solvers.skinning.linear import bones
        from shellbench.solvers.skinning.network import train_dense

        return train_dense(case, self.name, bones, settings, progress)

    def skin(self) -> Skin:
        """Return the function by which the network computes meshes."""
        from shellbench.solvers.skinning.forward import bone_skin

        return bone_skin


class ShapeSolver(SkinningSolver):
    """The paper's neural skinning, and its network of details."""

    name = "skin-shape"
    capabilities = Capabilities(
        THEORIES,
        "neural skinning and shape of Jin et al.: a second perceptron adds PCA modes of what the first one lacks",
    )
    settings_type = ShapeSettings

    def answer(self, case: SkinningCase, settings: ShapeSettings, progress: ProgressCallback) -> Skinned:
        """Train both networks from bones, one after the other."""
        from shellbench.solvers.skinning.linear import bones
        from shellbench.solvers.skinning.network import train_dense

        first = train_dense(case, self.name, bones, settings, progress)
        second = settings.model_copy(update={"learning_rate": settings.shape_rate})
        return train_dense(case, self.name, bones, second, progress, first)

    def skin(self) -> Skin:
        """Return the function by which both networks compute meshes."""
        from shellbench.solvers.skinning.forward import shape_skin

        return shape_skin


class ChainsSolver(SkinningSolver):
    """A network with a memory for each chain, and the paper's neural skinning on top."""

    name = "skin-recurrent-chains"
    capabilities = Capabilities(
        THEORIES, "a gated recurrent unit a chain from the body's motion to its bones, then neural skinning"
    )
    settings_type = ChainSettings

    def answer(self, case: SkinningCase, settings: ChainSettings, progress: ProgressCallback) -> Skinned:
        """Train the perceptron on true bones, then the units."""
        from shellbench.solvers.skinning.linear import bones
        from shellbench.solvers.skinning.network import train_chains, train_dense

        told = NetworkSettings(modes=settings.modes, epochs=settings.skin_epochs, seed=settings.seed)
        return train_chains(case, self.name, settings, progress, train_dense(case, self.name, bones, told, progress))

    def skin(self) -> Skin:
        """Return the function by which units and perceptron compute meshes."""
        from shellbench.solvers.skinning.forward import chains_skin

        return chains_skin


class QuasistaticSolver(SkinningSolver):
    """A network whose input is the pose, without motion."""

    name = "skin-quasistatic"
    capabilities = Capabilities(THEORIES, "quasistatic network: perceptron 2 x 500 from the body's pose alone")
    settings_type = QuasistaticSettings

    def answer(self, case: SkinningCase, settings: QuasistaticSettings, progress: ProgressCallback) -> Skinned:
        """Train from poses."""
        from shellbench.solvers.skinning.forward import pose
        from shellbench.solvers.skinning.network import train_dense

        return train_dense(case, self.name, pose, settings, progress)

    def skin(self) -> Skin:
        """Return the function by which the network computes meshes."""
        from shellbench.solvers.skinning.forward import pose_skin

        return pose_skin


class RecurrentSolver(SkinningSolver):
    """A network with a memory instead of bones."""

    name = "skin-recurrent"
    capabilities = Capabilities(THEORIES, "gated recurrent unit from the body's motion, without bones")
    settings_type = RecurrentSettings

    def answer(self, case: SkinningCase, settings: RecurrentSettings, progress: ProgressCallback) -> Skinned:
        """Train on clips."""
        from shellbench.solvers.skinning.network import train_recurrent

        return train_recurrent(case, self.name, settings, progress)

    def skin(self) -> Skin:
        """Return the function by which the recurrent unit computes meshes."""
        from shellbench.solvers.skinning.forward import recurrent_skin

        return recurrent_skin
