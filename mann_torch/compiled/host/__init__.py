"""From C++ text to kernels that can be called: Warp, and its cache on disk."""
