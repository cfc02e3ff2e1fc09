"""The model in Kratos: a NURBS surface whose quadrature points are Kirchhoff-Love elements, `Shell3pElement`.

Kratos builds and solves all systems of equations. Its input is the control points, the material, the constraints, and
forces on the control points; its output is their displacements.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.question.conditions import Material
from shellbench_kratos.engine import FreshModel, fresh_model, kratos, structural
from shellbench_kratos.iga_conditions import Conditions
from shellbench_kratos.nurbs import Midsurface

Array = NDArray[np.float64]

ELEMENT = "Shell3pElement"
DERIVATIVES = 3  # of the shape functions that Kratos makes ready, counted from the value: the element needs two
LINEAR_SOLVER = "LinearSolversApplication.sparse_lu"  # Eigen's; the wheels bring no MKL
NEWTON_ITERATIONS = 25  # of one load step before it is halved: quadratic convergence needs a third of them
NEWTON_STEP = 1e-9  # of Newton's last step, relative to the displacement


@dataclass
class IgaModel:
    """A patch in Kratos.

    Attributes
    ----------
    midsurface, conditions
        Input of the model.
    fresh
        Model and model part.
    linear, strategy
        Whether strains are linearised; Kratos' strategy for it, a single solve or Newton's method.
    """

    midsurface: Midsurface
    conditions: Conditions
    fresh: FreshModel
    linear: bool
    strategy: Any = field(default=None)

    @classmethod
    def from_midsurface(
        cls, midsurface: Midsurface, conditions: Conditions, material: Material, linear: bool
    ) -> IgaModel:
        """Build the model."""
        fresh = fresh_model(kratos.DISPLACEMENT, kratos.REACTION, structural.POINT_LOAD)
        model = cls(midsurface, conditions, fresh, linear)
        nodes = model._add_nodes()
        properties = fresh.part.CreateNewProperties(0)
        properties[kratos.YOUNG_MODULUS] = material.youngs_modulus
        properties[kratos.POISSON_RATIO] = material.poissons_ratio
        properties[kratos.THICKNESS] = material.thickness
        properties.SetValue(kratos.CONSTITUTIVE_LAW, structural.LinearElasticPlaneStress2DLaw())
        model._add_elements(nodes, properties)
        for number in range(1, fresh.part.NumberOfNodes() + 1):
            fresh.part.CreateNewCondition("PointLoadCondition3D1N", number, [number], properties)
        model._add_conditions()
        model.strategy = model._made_strategy()
        model.strategy.SetEchoLevel(0)
        model.strategy.Initialize()  # now, at rest: elements take the present shape as the one without strains
        return model

    def _add_nodes(self) -> Any:
        """Add the control points, numbered from 1 with the first coordinate running fastest, as Kratos has them."""
        nodes = kratos.NodesVector()
        for number, point in enumerate(self._in_order(np.moveaxis(self.midsurface.control_points, -1, 0)).tolist(), 1):
            nodes.append(self.fresh.part.CreateNewNode(number, *point))
        return nodes

    @staticmethod
    def _in_order(values: Array) -> Array:
        """Return components (3, n1, n2) as Kratos numbers them, (n1 n2, 3)."""
        return np.asarray(np.transpose(values, (2, 1, 0)).reshape(-1, len(values)))

    def _node(self, flat: int) -> Any:
        """Return the node of a control point's number in C order of (n1, n2)."""
        first, second = divmod(flat, self.conditions.fixed.shape[2])
        return self.fresh.part.Nodes[1 + first + self.conditions.fixed.shape[1] * second]

    def _add_elements(self, nodes: Any, properties: Any) -> None:
        patch = self.midsurface.patch
        # Kratos leaves out the first and the last knot
        knots = [kratos.Vector(basis.knots[1:-1].tolist()) for basis in patch.bases]
        weights = kratos.Vector(patch.weights.T.ravel().tolist())
        degree = patch.bases[0].degree
        surface = kratos.NurbsSurfaceGeometry3D(nodes, degree, degree, *knots, weights)
        points = kratos.GeometriesVector()
        surface.CreateQuadraturePointGeometries(points, DERIVATIVES)
        create = self.fresh.part.CreateNewElement
        for number in range(len(points)):
            create(ELEMENT, number + 1, points[number], properties)

    def _add_conditions(self) -> None:
        part, conditions = self.fresh.part, self.conditions
        variables = (kratos.DISPLACEMENT_X, kratos.DISPLACEMENT_Y, kratos.DISPLACEMENT_Z)
        reactions = (kratos.REACTION_X, kratos.REACTION_Y, kratos.REACTION_Z)
        number = 0
        for component, variable in enumerate(variables):
            kratos.VariableUtils().AddDof(variable, reactions[component], part)
            for flat in np.flatnonzero(conditions.fixed[component]):
                self._node(int(flat)).Fix(variable)
            leaders = conditions.leader[component].ravel()
            own = leaders == np.arange(leaders.size)
            for flat in np.flatnonzero(~own & ~conditions.fixed[component].ravel()):
                number += 1
                part.CreateNewMasterSlaveConstraint(
                    "LinearMasterSlaveConstraint",
                    number,
                    self._node(int(leaders[flat])),
                    variable,
                    self._node(int(flat)),
                    variable,
                    1.0,
                    0.0,
                )

    def displacements(self) -> Array:
        """Return the displacements (n1, n2, 3) of the control points, m."""
        values = kratos.VariableUtils().GetSolutionStepValuesVector(self.fresh.part.Nodes, kratos.DISPLACEMENT, 0, 3)
        _, n1, n2 = self.conditions.fixed.shape
        return np.ascontiguousarray(np.swapaxes(np.array(values).reshape(n2, n1, 3), 0, 1))

    def start_from(self, displacements: Array) -> None:
        """Bring the control points to displacements (n1, n2, 3)."""
        nodes = self.fresh.part.Nodes
        values = kratos.Vector(self._in_order(np.moveaxis(displacements, -1, 0)).ravel().tolist())
        kratos.VariableUtils().SetSolutionStepValuesVector(nodes, kratos.DISPLACEMENT, values, 0)
        if not self.linear:
            kratos.VariableUtils().UpdateCurrentPosition(nodes)

    def prescribe(self, component: int, point: tuple[int, int], value: float) -> None:
        """Hold a component of a control point, and the components tied to it, at a displacement, m."""
        variable = (kratos.DISPLACEMENT_X, kratos.DISPLACEMENT_Y, kratos.DISPLACEMENT_Z)[component]
        leaders = self.conditions.leader[component]
        for flat in np.flatnonzero(leaders == leaders[point]):
            self._node(int(flat)).SetSolutionStepValue(variable, 0, value)
        self._node(int(leaders[point])).Fix(variable)
        kratos.VariableUtils().UpdateCurrentPosition(self.fresh.part.Nodes)

    def solve(self, forces: Array) -> bool:
        """Solve for the displacements under forces (3, n1, n2) on the control points, N; False if Newton fails."""
        values = kratos.Vector(self._in_order(forces).ravel().tolist())
        kratos.VariableUtils().SetSolutionStepValuesVector(self.fresh.part.Nodes, structural.POINT_LOAD, values, 0)
        self.strategy.InitializeSolutionStep()
        self.strategy.Predict()
        converged = bool(self.strategy.SolveSolutionStep())
        self.strategy.FinalizeSolutionStep()
        return (converged or self.linear) and bool(np.all(np.isfinite(self.displacements())))

    @property
    def iterations(self) -> int:
        """Newton's iterations in the last solve."""
        return 1 if self.linear else int(self.fresh.part.ProcessInfo[kratos.NL_ITERATION_NUMBER])

    def _made_strategy(self) -> Any:
        scheme = kratos.ResidualBasedIncrementalUpdateStaticScheme()
        solver = kratos.LinearSolverFactory().Create(kratos.Parameters(f'{{"solver_type": "{LINEAR_SOLVER}"}}'))
        builder = kratos.ResidualBasedBlockBuilderAndSolver(solver)
        reactions, reform, norm, move = False, False, False, not self.linear
        if self.linear:
            return kratos.ResidualBasedLinearStrategy(self.fresh.part, scheme, builder, reactions, reform, norm, move)
        size = float(np.ptp(self.midsurface.control_points.reshape(-1, 3), axis=0).max())
        criterion = kratos.DisplacementCriteria(NEWTON_STEP, np.finfo(float).eps * size)
        criterion.SetEchoLevel(0)
        return kratos.ResidualBasedNewtonRaphsonStrategy(
            self.fresh.part, scheme, criterion, builder, NEWTON_ITERATIONS, reactions, reform, move
        )
