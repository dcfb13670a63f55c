"""What a run shows of itself: metrics, arrays, TensorBoard."""
