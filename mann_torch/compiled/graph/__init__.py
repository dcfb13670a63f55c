"""The compiler's own graphs: nodes, and the constructors that simplify them."""
