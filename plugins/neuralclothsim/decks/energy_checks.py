"""Compare strain energies of the released NeuralClothSim with exact ones: python energy_checks.py PATH_OF_CLONE."""
import math, sys, types
from unittest.mock import MagicMock
for name in ". .io .structures .renderer .renderer.mesh .renderer.mesh.textures .ops .ops.mesh_face_areas_normals .ops.packed_to_padded".split():
    sys.modules["pytorch3d" + name.rstrip(".")] = sys.modules["configargparse"] = sys.modules["tqdm"] = MagicMock()
sys.path.insert(0, sys.argv[1])
import torch, utils.tb, energy, material, reference_geometry, strain
utils.tb.writer, N, _ = None, 200, torch.set_default_dtype(torch.float64)
flat = type("Flat", (), {"reference_geometry_name": "mesh", "__call__": lambda self, xi: torch.cat([xi, 0 * xi[..., :1] ** 2 * xi[..., 1:] ** 2], -1)})()
def densities(kind, length, k, stretch, **numbers):  # mean square of the bending strain, and energy per area, of a strip
    (geometry := reference_geometry.ReferenceGeometry(flat, N, 1))(torch.stack([length * (torch.arange(N) + 0.5) / N, torch.zeros(N)], -1)[None].requires_grad_(), False)
    x, y = geometry.curvilinear_coords.unbind(-1)
    turn = k * (1 + stretch) * x
    u = torch.stack([torch.sin(turn) / k - x, 0 * x**3 * y**3, (1 - torch.cos(turn)) / k], -1)
    total = energy.Energy(geometry, kind(types.SimpleNamespace(mass_area_density=0.0, i_debug=2, StVK=True, **numbers), geometry), [0.0, 0.0, 0.0], False, 2)
    return (strain.compute_strain(u, geometry, 1, 2)[0].kappa_1_1 ** 2).mean().item(), total(u, None, 1).mean().item()
for k in map(math.radians, (10, 45, 90, 180)):
    print(f"rolled by {math.degrees(k):.0f} degrees: {densities(material.LinearMaterial, 1.0, k, 0.0, youngs_modulus=1.0, poissons_ratio=0.0, thickness=1.0)[0] / k**2:.4f} of the exact bending energy")
for stretch, k, h, a in ((1e-3, 1e-9, 3.7e-4, 5.366), (0.0, 30.0, 3.7e-4, 5.366), (1e-3, 30.0, 3.7e-4, 5.366), (1e-3, -30.0, 3.7e-4, 5.366)):
    print(f"stretch {stretch:g}, curvature {k:g}/m: {densities(material.NonLinearMaterial, 1e-4, k, stretch, thickness=h, a11=a, a12=0.0, a22=a, G12=a / 2)[1]:.3g} J/m^2, exact {a / 2 * ((stretch + stretch**2 / 2) ** 2 + (h * k) ** 2 / 12):.3g}")
