"""Shell elements of CalculiX answer the cases."""
