"""Fold one hinge of newton's cloth by 0.1 rad: its moments about the edge, over edge_ke times length times angle."""
import newton, numpy as np, warp as wp
from newton.solvers import SolverSemiImplicit, SolverVBD, SolverXPBD
wp.config.quiet = True
def moments(kind, near, far, edge, length=1e-2, angle=0.1):  # heights of the two triangles, length of their edge
    places = [(-near, 0, 0), (far * np.cos(angle), 0, far * np.sin(angle)), (0, -edge / 2, 0), (0, edge / 2, 0)]
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_particles([wp.vec3(*p) for p in places], [wp.vec3()] * 4, [1.0] * 4, [0.0] * 4)
    builder.add_edges([0], [1], [2], [3], rest=[0.0], edge_ke=[1.0], edge_kd=[0.0])
    builder.color(include_bending=True)
    model = builder.finalize(device="cpu")
    one, two = model.state(), model.state()
    kind(model, **({} if kind is SolverSemiImplicit else {"iterations": 1})).step(one, two, model.control(), None, length)
    force = two.particle_qd.numpy() / length
    return np.linalg.norm(force[0]) * near / (edge * angle), np.linalg.norm(force[1]) * far / (edge * angle)
for name, kind in (("VBD", SolverVBD), ("semi-implicit", SolverSemiImplicit), ("XPBD", SolverXPBD)):
    for near, far, edge in ((1.0, 1.0, 1.0), (0.1, 0.1, 0.1), (1.0, 2.0, 1.0)):
        print("{}, heights {} and {} m, edge {} m: {:.3f} and {:.3f}".format(name, near, far, edge, *moments(kind, near, far, edge)))
