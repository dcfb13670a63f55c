"""Problems with known answers: what is known, how ours is measured, and what comes of it."""
