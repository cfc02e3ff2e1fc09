"""The published loss in its plainest form: nested automatic differentiation, index by index as the paper writes it.

Nothing of `shellbench.solvers.ndf` is used: geometry from the surface's derivatives in NumPy, the network from its raw weights,
u,a and u,ab by `torch.autograd.grad` on `torch.autograd.grad`.
"""

import numpy as np
import torch

PAIRS = [(0, 0), (0, 1), (1, 0), (1, 1)]


def siren(inputs, weights, biases, omega0):
    h = inputs
    for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
        h = torch.sin(omega0 * (h @ weight.T + bias))
    return h @ weights[-1].T + biases[-1]


def displacement(case, xi, weights, biases, omega0, factor):
    """u = B F at points (N, 2): inputs in [0, 1], periodic ones as cosine and sine."""
    domain, inputs = case.surface.domain, []
    for axis in range(2):
        share = (xi[:, axis] - domain.lower[axis]) / domain.size[axis]
        angle = 2 * np.pi * share
        inputs += [torch.cos(angle), torch.sin(angle)] if domain.periodic[axis] else [share]
    return siren(torch.stack(inputs, -1), weights, biases, omega0) * factor(xi)


def nested_loss(case, points, weights, biases, omega0, factor, loads, modulus_factor=1.0):
    """Equation (67): `loads` are (point, force) pairs, `factor` gives the (N, 3) factors of the components."""
    dtype = weights[0].dtype

    def tensor(values):
        return torch.as_tensor(np.ascontiguousarray(values), dtype=dtype)

    x = case.surface.derivatives(points, 2)
    base = [x[1, 0], x[0, 1]]
    second = {(0, 0): x[2, 0], (0, 1): x[1, 1], (1, 0): x[1, 1], (1, 1): x[0, 2]}
    normal = np.cross(*base)
    root = np.linalg.norm(normal, axis=-1)
    normal = normal / root[:, None]
    metric = np.stack([np.stack([(p * q).sum(-1) for q in base], -1) for p in base], -2)
    inverse = np.linalg.inv(metric)
    dual = [sum(inverse[:, a, b, None] * base[b] for b in range(2)) for a in range(2)]
    christoffel = {(m, *ab): (dual[m] * second[ab]).sum(-1) for m in range(2) for ab in PAIRS}

    xi = tensor(points).requires_grad_()
    u = displacement(case, xi, weights, biases, omega0, factor)
    first = [torch.autograd.grad(u[:, c].sum(), xi, create_graph=True)[0] for c in range(3)]
    d = [torch.stack([g[:, a] for g in first], -1) for a in range(2)]
    curved = [[torch.autograd.grad(g[:, a].sum(), xi, create_graph=True)[0] for a in range(2)] for g in first]
    dd = {(a, b): torch.stack([curved[c][a][:, b] for c in range(3)], -1) for a, b in PAIRS}

    eps, kappa = {}, {}
    for a, b in PAIRS:
        eps[a, b] = 0.5 * ((d[a] * tensor(base[b])).sum(-1) + (d[b] * tensor(base[a])).sum(-1))
        covariant = dd[a, b] - sum(tensor(christoffel[m, a, b])[:, None] * d[m] for m in range(2))
        kappa[a, b] = -(covariant * tensor(normal)).sum(-1)

    material = case.material
    nu, g = material.poissons_ratio, inverse
    membrane = modulus_factor * material.youngs_modulus * material.thickness / (1 - nu**2)
    bending = membrane * material.thickness**2 / 12
    density = torch.zeros(len(points), dtype=dtype)
    for a, b in PAIRS:
        for c, e in PAIRS:
            h = nu * g[:, a, b] * g[:, c, e] + (1 - nu) / 2 * (g[:, a, c] * g[:, b, e] + g[:, a, e] * g[:, b, c])
            density = density + 0.5 * tensor(h) * (
                membrane * eps[a, b] * eps[c, e] + bending * kappa[a, b] * kappa[c, e]
            )
    for load in case.loads:
        if load.kind == "area":
            density = density - (tensor(case.evaluate(load.vector, points)[0, 0]) * u).sum(-1)
    loss = np.prod(case.surface.domain.size) / len(points) * (density * tensor(root)).sum()
    for point, force in loads:
        at = displacement(case, tensor([point]), weights, biases, omega0, factor)
        loss = loss - (at[0] * tensor(force)).sum()
    return loss


def plate_factor(xi):
    """Equation (61) for the square plate of side 100, with its maximum brought to 1."""
    return (16 * xi[:, :1] * xi[:, 1:] * (100 - xi[:, :1]) * (100 - xi[:, 1:]) / 1e8).expand(-1, 3)


def diaphragm_factor(xi):
    """Equation (65) for the cylinder of length 600, with its maximum brought to 1."""
    b = 4 * xi[:, 1] * (600 - xi[:, 1]) / 600**2
    return torch.stack([b, torch.ones_like(b), b], -1)
