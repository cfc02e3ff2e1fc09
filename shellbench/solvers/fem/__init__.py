"""The classical reference: C1 finite elements for Kirchhoff-Love shells."""
