"""A step marched through time: layout, the loop around it, checkpoints, autograd."""
