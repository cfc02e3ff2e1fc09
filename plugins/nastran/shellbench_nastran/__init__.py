"""Shell elements of MYSTRAN, a free Nastran, answer the cases."""
