"""Edited shells: one is solved, then an edit of it, from the earlier solution and from scratch."""
