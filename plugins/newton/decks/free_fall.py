"""Drop a cloth of newton's own grid for one second: the distance over g t^2/2, by solver and time step."""
import newton, warp as wp
from newton.solvers import SolverStyle3D, SolverVBD, style3d
wp.config.quiet = True
def fall(name, step):
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -9.8))
    grid = dict(pos=wp.vec3(0, 0, 0), rot=wp.quat_identity(), vel=wp.vec3(0, 0, 0), dim_x=4, dim_y=4, cell_x=0.1, cell_y=0.1, mass=0.01)
    if name == "Style3D":
        SolverStyle3D.register_custom_attributes(builder)
        style3d.add_cloth_grid(builder, tri_aniso_ke=wp.vec3(1e2, 1e2, 1e1), edge_aniso_ke=wp.vec3(2e-5, 1e-5, 5e-6), **grid)
    else:
        builder.add_cloth_grid(tri_ke=1e2, tri_ka=1e2, tri_kd=0.0, edge_ke=1e-4, edge_kd=0.0, **grid)
        builder.color(include_bending=True)
    solver = (SolverStyle3D if name == "Style3D" else SolverVBD)(model := builder.finalize(device="cpu"))
    old, new, control, contacts = model.state(), model.state(), model.control(), model.contacts()
    for _ in range(round(1 / step)):
        old, new = (solver.step(old, new, control, contacts, step), (new, old))[1]
    return -old.particle_q.numpy()[:, 2].mean() / 4.9
for step in (1 / 60, 1 / 240):
    print(f"step {step:.2e} s:", {name: round(float(fall(name, step)), 4) for name in ("VBD", "Style3D")}, flush=True)
