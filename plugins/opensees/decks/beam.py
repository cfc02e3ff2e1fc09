"""Bend the thick twisted beam of MacNeal & Harder by a shell element of OpenSees: `python beam.py ShellDKGQ 8 88`.

Numbers of cells across and along follow the element. A force of 1 along y is put on the nodes of its end by the
trapezoidal rule. Only openseespy is used, nothing of shellbench. Prints how far the middle of the end moves along y:
.001750742 in thin theory. Triangles take the diagonal from the first corner.
"""

import sys
from math import cos, pi, sin

import openseespy.opensees as ops

YOUNG, POISSON, THICKNESS, LENGTH, WIDTH = 29e6, 0.22, 0.32, 12.0, 1.1


def deflection(kind, across, along):
    """Return the displacement of the end's middle along y."""
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    number = lambda i, j: i * (across + 1) + j + 1
    for i in range(along + 1):
        turn = pi / 2 * i / along
        for j in range(across + 1):
            aside = WIDTH * (j / across - 0.5)
            ops.node(number(i, j), LENGTH * i / along, aside * cos(turn), aside * sin(turn))
        if i == 0:
            for j in range(across + 1):
                ops.fix(number(0, j), 1, 1, 1, 1, 1, 1)
    ops.section("ElasticMembranePlateSection", 1, YOUNG, POISSON, THICKNESS, 0.0)
    tag = 0
    for i in range(along):
        for j in range(across):
            a, b, c, d = number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)
            for corners in [(a, b, c), (a, c, d)] if kind[-1] in "T3" else [(a, b, c, d)]:
                tag += 1
                ops.element(kind, tag, *corners, 1)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    for j in range(across + 1):
        ops.load(number(along, j), 0, (0.5 if j in (0, across) else 1.0) / across, 0, 0, 0, 0)
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("UmfPack")
    ops.integrator("LoadControl", 1.0)
    ops.algorithm("Linear")
    ops.analysis("Static")
    if ops.analyze(1):
        raise SystemExit("OpenSees finds no equilibrium")
    return ops.nodeDisp(number(along, across // 2), 2)


if __name__ == "__main__":
    print(deflection(sys.argv[1], *map(int, sys.argv[2:4])))
