"""Skinning a cape from bones: linear methods, and the networks of Jin et al."""
