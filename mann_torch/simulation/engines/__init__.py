"""What runs a `Task`: PyTorch step by step, or the compiled march."""
