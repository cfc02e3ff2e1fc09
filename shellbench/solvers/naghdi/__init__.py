"""Shells whose normals shear: Naghdi's theory by a trained network (Bastek & Kochmann 2023)."""
