"""Strains and stiffness of a shell on one mesh, its loads and supports, and its solution.

Supports are applied in steps: `constraints` states each of them at nodes, and `ties` resolves all of them as u = T q +
u0. A clamp has two more conditions: `bubble_conditions` for bubbles, and `clamping` between the nodes of edges on which
the normal turns. It may import `mesh` and `algebra`.
"""
