"""Print how much single shell elements of OpenSees resist rigid motions, flat and warped.

A rigid motion strains nothing, so that forces should vanish, and an element should have six modes without energy, no
more. Forces are relative to the largest entry of the stiffness. The warped cell has one corner 0.1 above the others.
"""

import numpy as np
import openseespy.opensees as ops

FLAT = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
WARPED = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0.1), (0, 1, 0)])


def stiffness(kind, corners):
    """Return the stiffness (6 v, 6 v) of one element of steel, a tenth as thick as wide."""
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    for tag, place in enumerate(corners.tolist(), 1):
        ops.node(tag, *place)
    ops.section("ElasticMembranePlateSection", 1, 2e11, 0.3, 0.1, 0.0)
    ops.element(kind, 1, *range(1, len(corners) + 1), 1)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(1, 1.0, 0, 0, 0, 0, 0)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("FullGeneral")
    ops.integrator("LoadControl", 1.0)
    ops.algorithm("Linear")
    ops.analysis("Static")
    ops.analyze(1)  # singular: only the matrix is asked for
    return np.array(ops.printA("-ret")).reshape(2 * (6 * len(corners),))


def resistance(kind, corners):
    """Return the largest relative force against six rigid motions, and the number of modes without energy."""
    matrix = stiffness(kind, corners)
    matrix = matrix / np.abs(matrix).max()
    moves, turns = np.zeros((2, len(corners), 6, 3))
    moves[:, :3], turns[:, 3:] = np.eye(3), np.eye(3)
    turns[:, :3] = [np.cross(np.eye(3), place).T for place in corners]
    rigid = np.concatenate([moves, turns], axis=-1).reshape(-1, 6)
    return np.abs(matrix @ rigid).max(), int(np.sum(np.abs(np.linalg.eigvalsh(matrix + matrix.T)) < 1e-9))


if __name__ == "__main__":
    for kind, count in (("ShellMITC4", 4), ("ShellDKGQ", 4), ("ASDShellQ4", 4), ("ShellDKGT", 3), ("ASDShellT3", 3)):
        for name, corners in (("flat", FLAT), ("warped", WARPED))[: count - 2]:
            force, modes = resistance(kind, corners[:count])
            print(f"{kind:11} {name:7} force {force:.1e}, {modes} modes without energy")
