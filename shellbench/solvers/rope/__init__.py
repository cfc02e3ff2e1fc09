"""Chains of point masses on rigid links in motion, by the published scheme as printed, and corrected."""
