"""Chains by constraints on positions: position-based dynamics and its compliant form."""
