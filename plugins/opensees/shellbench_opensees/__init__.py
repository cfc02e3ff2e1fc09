"""Shell elements of OpenSees answer the cases."""
