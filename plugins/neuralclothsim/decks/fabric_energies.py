"""Compare energies of the released NeuralClothSim's silk, cotton and canvas with `fem`'s: python fabric_energies.py PATH_OF_CLONE."""
import ast, configparser, math, sys, types
from unittest.mock import MagicMock
for name in ". .io .structures .renderer .renderer.mesh .renderer.mesh.textures .ops .ops.mesh_face_areas_normals .ops.packed_to_padded".split():
    sys.modules["pytorch3d" + name.rstrip(".")] = sys.modules["configargparse"] = sys.modules["tqdm"] = MagicMock()
sys.path.insert(0, sys.argv[1])
import numpy as np, torch, utils.tb, energy, material, reference_geometry, strain
from shellbench.problems.shell.question.orthotropic import OrthotropicMaterial
from shellbench.solvers.fem.mechanics.orthotropic import StiffeningMembrane
utils.tb.writer, _ = None, torch.set_default_dtype(torch.float64)
flat = type("Flat", (), {"reference_geometry_name": "mesh", "__call__": lambda self, xi: torch.cat([xi, 0 * xi[..., :1] ** 2 * xi[..., 1:] ** 2], -1)})()
def densities(m, own, e, k, n=40):  # J/m^2 of a point strained by e and curved by k along the warp: released, Simpson's rule, fem
    x = torch.tensor([[[1e-5 * (i + 0.5) / n, 0.0] for i in range(n)]]).requires_grad_()
    (geometry := reference_geometry.ReferenceGeometry(flat, n, 1))(x, False)
    (s, t), stretch = geometry.curvilinear_coords.unbind(-1), math.sqrt(1 + 2 * e)
    kappa = k / stretch if k else 1e-9  # per length of the cloth at rest, as kappa = bbar - b has it
    u = torch.stack([stretch * torch.sin(kappa * s) / kappa - s, 0 * s**3 * t**3, stretch * (1 - torch.cos(kappa * s)) / kappa], -1)
    law, axes = material.NonLinearMaterial(m, geometry), material.MaterialOrthotropy(torch.tensor([[[1.0, 0, 0]]]).expand(1, n, 3), torch.tensor([[[0, 1.0, 0]]]).expand(1, n, 3))
    released = energy.Energy(geometry, law, [0.0, 0.0, 0.0], False, 2)(u, None, 1).mean().item()
    found = strain.compute_strain(u, geometry, 1, 2)[0]
    simpson = sum(w * law.compute_internal_energy(found, axes, 1, z * m.thickness).mean().item() for w, z in ((1, -0.5), (4, 0.0), (1, 0.5))) / 6
    ours = StiffeningMembrane(own, np.eye(3)[None]).respond(np.array([[e, 0.0, 0.0]]))[0].item() + own.stiffnesses[1][0, 0] * found.kappa_1_1.mean().item() ** 2 / 2
    return released, simpson, ours
for name in ("silk", "cotton", "canvas"):
    (ini := configparser.ConfigParser(default_section="none")).read(f"{sys.argv[1]}/material/{name}.ini")
    m = types.SimpleNamespace(i_debug=2, StVK=False, **{key.replace("g12", "G12").replace("e_", "E_"): ast.literal_eval(v) for part in ini.sections()[1:] for key, v in ini[part].items()})
    a, curves = np.array([m.a11, m.a12, m.a22, m.G12 / 2]), zip(("warp", "weft", "shear"), (0, 2, 3), (m.E_11_max, m.E_22_max, m.E_12_max))
    stiffening = {way: {"mu": getattr(m, f"mu{j + 1}"), "alpha": getattr(m, f"alpha{j + 1}"), "until": until} for way, j, until in curves}
    own = OrthotropicMaterial.model_validate({"kind": "orthotropic", "thickness": m.thickness, "membrane": a.tolist(), "bending": (m.thickness**2 / 12 * a).tolist(), "stiffening": stiffening})
    for e in (0.0, 0.02):
        rest = np.array(densities(m, own, e, 0.0))
        folds = np.array([densities(m, own, e, 30 * math.sin(2 * math.pi * (j + 0.5) / 16)) for j in range(16)]) - rest
        napkin, one, other = folds.mean(axis=0), folds[:8].mean(axis=0), folds[8:].mean(axis=0)
        shares = ", ".join(f"{100 * found[0] / found[1]:.0f} %" for found in (napkin, one, other))
        print(f"{name}, stretch {e:g}: bending {napkin[1]:.3g} J/m^2, fem {napkin[2]:.3g}; released {shares} (folds both ways, one way, the other)" + (f"; stretching {rest[0] / rest[1]:.3f}" if e else ""))
    curled = min(densities(m, own, e, 30.0)[0] for e in -m.thickness * 30 * np.linspace(0, 0.5, 21))
    print(f"{name}, curled to 30/m, at its most favourable strain: released {100 * curled / densities(m, own, 0.0, 30.0)[1]:.0f} %")
