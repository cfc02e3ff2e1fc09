"""Solvers on newton's cloth."""
