"""Chains of point masses on rigid links."""
