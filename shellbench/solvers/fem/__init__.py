"""The classical reference: C1 Bogner-Fox-Schmit finite elements for Kirchhoff-Love shells."""
