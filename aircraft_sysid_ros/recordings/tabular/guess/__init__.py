"""A first MAP from names, units, values and physics, with how sure each line of it is."""
