"""The published training (Kairanda et al., NeuralClothSim): `ndf-published` and `ndf-material`.

At rest, in motion, and with the material as an input. It may import `conditioned`, `motion` and the rooms below them.
"""
