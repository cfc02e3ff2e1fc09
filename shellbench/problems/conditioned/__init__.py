"""Shells of a range of materials: one answer for all of them, judged at materials that were held out."""
