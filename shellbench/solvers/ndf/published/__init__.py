"""The published training (Kairanda et al. 2023, NeuralClothSim): `ndf-published` and `ndf-material`.

It covers shells at rest, in motion, and with the material as an input. It may import `conditioned`, `motion` and the
packages below them.
"""
