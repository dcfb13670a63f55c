"""Text of arithmetic on lanes: one trajectory a lane."""
