"""The classical reference: C1 finite elements for Kirchhoff-Love shells.

The bench calls `solver`, and `solving` chooses the package that solves the case: `linear` at rest, `path` at finite
strain, `motion` in time. Each solves on one mesh; `refinement` makes the next one. Strains, loads and supports are in
`mechanics`, the elements and their points in `mesh`, matrices and their solution in `algebra`.
"""
