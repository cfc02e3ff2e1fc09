"""Sections on one question each: strains, thinness, motions, cloth, ropes, learned fields, stiffnesses.

They may import data, figures and the general sections of the report, and no page.
"""
