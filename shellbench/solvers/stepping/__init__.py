"""Step control of equilibrium paths, written once for all solvers: halving and growing steps, marks, limit points.

A room below the solvers. It knows a state by its load factor, its stability and the iterations that led to it, and asks
the solver for everything else. It has no mechanics: strains, forces, tangents and Newton's method are the solvers' own.
It may import the standard library and nothing else.
"""
