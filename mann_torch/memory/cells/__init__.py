"""The memory as a recurrent cell: its step, its state, its options."""
