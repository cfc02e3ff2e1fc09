"""Strains and stiffness of a shell on one mesh, its loads and supports, and the field that is found.

Where a support is applied: `constraints` states it at nodes, and `ties` resolves all of them as u = T q + u0. A clamp
is stated twice more: `bubble_conditions` for bubbles, `clamping` between the nodes of edges on which the normal turns.
It may import `mesh` and `algebra`.
"""
