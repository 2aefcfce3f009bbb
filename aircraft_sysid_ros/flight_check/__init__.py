"""A flight as data, before anything is estimated: what its samples say of each other and of themselves."""
