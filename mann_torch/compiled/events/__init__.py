"""Steps that stop at events: a skeleton in C++ around pieces that are traced."""
