"""Steps that stop at a switch or a reset, in PyTorch: the reference of the compiled ones."""
