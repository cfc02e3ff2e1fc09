"""The linear shell on one mesh: equilibrium, contact, vibrations and buckling loads, and cases that mirrors fold.

It may import `mesh`, `algebra` and `mechanics`.
"""
