"""One step of an ODE: the linearly implicit method, torchdiffeq's methods."""
