"""The memory beside other sequence models of equal size."""
