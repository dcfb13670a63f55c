"""From nodes to C++ statements."""
