"""Who is attended: soft, hard, reallocating, and the last two relaxed."""
